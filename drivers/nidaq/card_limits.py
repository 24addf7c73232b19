"""Limits of an NI card, asked before anything is set: sample rates, input range, and whether its outputs have a sample clock."""

import contextlib
from typing import Any

from nidaqmx.errors import DaqError

from drivers.errors import AcquisitionError, InstrumentError


def check_inputs(card: Any, where: str, channels: int, rate_hz: float, range_v: float) -> None:
    """Check that a card can acquire channels at this rate and range; a limit that its driver does not tell is not checked.

    Args:
        card: NI's object of the device.
        where: name of the card in messages.
        channels: number of channels of a scan.
        rate_hz: scans per second.
        range_v: input range, +- volts.

    Raises:
        AcquisitionError: it cannot; the message has the limit and the remedy.
    """
    limit_hz, simultaneous = _ask(card, "ai_max_multi_chan_rate"), _ask(card, "ai_simultaneous_sampling_supported")
    if limit_hz is not None:
        each_hz = float(limit_hz) / (1 if simultaneous else channels)
        if rate_hz > each_hz * (1 + 1e-9):
            raise AcquisitionError(
                f"{where} takes {limit_hz:g} samples/s {'of each channel' if simultaneous else 'of all channels together'}, not "
                f"{channels} channels at {rate_hz:g} Hz; lower the sample rate to {each_hz:g} Hz"
            )
    largest_v = max(_ask(card, "ai_voltage_rngs") or [range_v])
    if range_v > largest_v * (1 + 1e-6):
        raise AcquisitionError(
            f"{where} measures {largest_v:g} V of either sign at most, not {range_v:g} V; give card.range_v = {largest_v:g} if drive and sensor stay "
            "within it, or use another card"
        )


def largest_output_rate_hz(card: Any, where: str, needed_hz: float) -> float:
    """Return the largest sample rate of a card's outputs.

    Args:
        card: NI's object of the device.
        where: name of the card in messages.
        needed_hz: smallest sample rate of a drive.

    Raises:
        InstrumentError: it has no outputs, they are set by software only, or are too slow.
    """
    remedy = "use a card whose outputs have a sample clock, or a function generator with [source] kind = 'generator'"
    if (outputs := _ask(card, "ao_physical_chans")) is not None and not len(outputs):
        raise InstrumentError(f"{where} has no analogue output; {remedy}")
    if _ask(card, "ao_samp_clk_supported") is False:
        raise InstrumentError(
            f"{where} has outputs that are set by software, sample by sample: a drive would jump and stop with this computer. It is not "
            f"played; {remedy}"
        )
    limit_hz = _ask(card, "ao_max_rate")
    if limit_hz is not None and limit_hz < needed_hz:
        raise InstrumentError(
            f"{where} gives {limit_hz:g} samples/s, a drive takes at least {needed_hz:g} samples/s; {remedy}"
        )
    return float("inf") if limit_hz is None else float(limit_hz)


def _ask(card: Any, name: str) -> Any:
    """Return a property, or None if NI's driver does not know it for this card."""
    with contextlib.suppress(DaqError):
        return getattr(card, name)
    return None
