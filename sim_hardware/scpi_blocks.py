"""Binary blocks in SCPI messages: their bytes may look like an end of line, a comma or a quote, and are none.

A block is `#`, a digit, that many digits of length, and as many bytes (IEEE 488.2, 7.7.6). Siglent boxes write the length
as a parameter (`LENGTH,4096B`) and the bytes bare after `WAVEDATA,`. Messages are bytes, or the same as Latin-1 text.
"""

import re

_BLOCK = re.compile(r"(?<=[ ,])#([1-9])")
_BARE = re.compile(r"LENGTH,(\d+)B,[^\n]*?WAVEDATA,")
_MARK = "\x00"
"""Stands in a message where a block was; no driver sends it."""


def messages_in(received: bytes) -> tuple[list[str], bytes]:
    """The complete messages of what has been received, and the rest that is still to be completed."""
    text, messages, start, look = received.decode("latin-1"), [], 0, 0
    while (end := text.find("\n", look)) >= 0:
        span = _next_block(text, look, end)
        if span is not None and span[1] > end:
            look = span[1]
            if look > len(text):
                break
            continue
        messages.append(text[start:end])
        start = look = end + 1
    return messages, received[start:]


def lift_blocks(message: str) -> tuple[str, list[str]]:
    """The message with a mark in the place of each block, and the blocks' bytes as Latin-1 text."""
    blocks, look = [], 0
    while (span := _next_block(message, look, len(message))) is not None:
        begin, end, data = span
        blocks.append(message[data:end])
        message = message[:begin] + _MARK + message[end:]
        look = begin + 1
    return message, blocks


def put_back(argument: str, blocks: list[str]) -> str:
    """The block for an argument that is a mark; blocks are used up in order."""
    return blocks.pop(0) if argument == _MARK else argument


def _next_block(text: str, look: int, end: int) -> tuple[int, int, int] | None:
    """Begin, end and first data byte of the first block that begins in `text[look:end]`."""
    found = []
    if block := _BLOCK.search(text, look, end):
        digits = int(block[1])
        length = text[block.end() : block.end() + digits]
        size = int(length) if length.isdigit() and len(length) == digits else 1 << 30
        data = block.end() + digits
        found.append((block.start(), data + size, data))
    if bare := _BARE.search(text, look, end):
        found.append((bare.end(), bare.end() + int(bare[1]), bare.end()))
    return min(found, default=None)
