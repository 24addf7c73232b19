"""SCPI binary blocks: a message stays one message, whatever its bytes and fragments."""

import pytest

from drivers.transport import definite_length_block
from sim_hardware.wires.scpi_engine import extract_blocks, restore_block, split_received

NASTY = b'\n;,"#15\n\x00\xff WAVEDATA,'
SCPI = f"DATA:DAC VOLATILE,{definite_length_block(NASTY)};:SYST:ERR?"
BARE = "C1:WVDT WVNM,a,WAVEDATA," + NASTY.replace(b"\n", b"").decode("latin-1")


@pytest.mark.parametrize("message", [SCPI, BARE, SCPI + "\n*IDN?\n" + BARE])
@pytest.mark.parametrize("size", [1, 3, 1000])
def test_messages_are_put_together_from_any_pieces(message: str, size: int) -> None:
    wire, rest, seen = (message + "\n").encode("latin-1"), b"", []
    for first in range(0, len(wire), size):
        complete, rest = split_received(rest + wire[first : first + size])
        seen += complete
    assert rest == b""
    assert "\n".join(seen) == message
    assert len(seen) == 1 + 2 * ("*IDN?" in message)


@pytest.mark.parametrize("message", [SCPI, BARE])
def test_a_block_is_lifted_out_and_put_back_whole(message: str) -> None:
    lifted, blocks = extract_blocks(message)
    assert "\n" not in lifted
    assert restore_block("\x00", blocks).encode("latin-1") == (NASTY if message is SCPI else NASTY.replace(b"\n", b""))
    assert restore_block("VOLATILE", blocks) == "VOLATILE"


def test_the_bytes_of_a_siglent_waveform_end_its_message_at_a_line_feed() -> None:
    assert split_received(b"C1:WVDT WVNM,a,WAVEDATA,\x01\x02\x0a\x00\n") == (
        ["C1:WVDT WVNM,a,WAVEDATA,\x01\x02", "\x00"],
        b"",
    )


def test_a_hash_that_begins_no_block_is_text() -> None:
    assert split_received(b'DISP:TEXT "# 1"\n*IDN?\n') == (['DISP:TEXT "# 1"', "*IDN?"], b"")
