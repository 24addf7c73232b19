"""The same bench without a bench: one plant, virtual instruments on their real wires, faults, an operator."""
