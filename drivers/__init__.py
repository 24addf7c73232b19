"""Instruments: what each can do, how each is spoken to, and what the amplifier may be given."""
