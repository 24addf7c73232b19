"""Commissioning: measures at the amplifier's input what a driver assumes of its instrument, with high voltage off."""
