"""The beam, the skin, the amplifier map, and what follows from them."""
