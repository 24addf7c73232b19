"""NI-DAQmx errors translated into messages with a remedy for the operator."""

import contextlib
from collections.abc import Iterator

from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, RpcError

from drivers.deadlines import Deadline, in_progress
from drivers.errors import AcquisitionError, CardInUseError, InstrumentError, ScansLostError

REMEDIES = {
    -200279: "scans were lost because the program read too late; lower the rate or the load on this computer",
    -200621: "the output ran out of samples and stays where it was; connect the card to a separate USB port, or lower the load on this computer",
    -200018: "the output ran out of samples and stays where it was; connect the card to a separate USB port, or lower the load on this computer",
    -200016: "the output ran out of samples and stays where it was; connect the card to a separate USB port, or lower the load on this computer",
    -200290: "the output ran out of samples and stays where it was; lower the load on this computer",
    -200361: "scans were lost on the USB bus; connect the card to a port without other devices, or lower the rate",
    -200284: "the card gave no samples in time; check that it is powered and its sample clock runs",
    -200220: "no such device; check its name in NI MAX and in the bench file",
    -88705: "the card is not connected; check its USB cable and power",
    -201003: "the card was disconnected; check its USB cable and power",
    -200324: "the card is absent; check its USB cable and power",
    -50405: "the USB transfer was broken off; check the USB cable, and connect the card without a hub",
    -50808: "the USB transfer failed; check the USB cable, and connect the card without a hub",
    -201190: "the card has to be reconnected; with high voltage off at the amplifier, pull its USB cable and put it back",
    -200088: "the card's task is gone, as after a pulled USB cable; run again",
    -200022: "the card's lines are in use by another task or program; close that first",
    -89137: "the route of the start signal is in use by another task; leave start_trigger empty in the bench file",
    -200278: "more scans were requested from the card than its task takes; run again, and report it if it recurs",
    -50103: "the card is in use by another task or program; close that first",
    -200077: "the card cannot do this setting; correct rate, range or channel",
    -200081: "the card cannot sample that fast; lower the rate",
    -200332: "the card cannot sample that fast; lower the rate",
    -200561: "the output cannot be given this voltage; correct the amplifier's range in the bench file",
    -200289: "the drive came too late to be changed; nothing was rewritten",
    -200292: "NI's driver holds rewritten samples of this output back; run 'tactor-bench commission', which measures how it is stopped",
    -89136: "the card cannot start its output by this signal; leave start_trigger empty in the bench file",
    -200170: "no such channel on this card; correct it in the bench file",
}


RESERVED = -50103
REMOTE_RESERVED_REMEDY = "the card is reserved at the gRPC device server by another client, which may have died; close it, or start the server again"

SCANS_LOST = (-200279, -200361)


@contextlib.contextmanager
def translate_errors(device_name: str, *, remote: bool = False) -> Iterator[None]:
    """Raise AcquisitionError in place of NI's errors, or InstrumentError if the NI driver is not installed.

    A reserved card of this computer (not `remote`) raises CardInUseError: NI's driver clears the reservation of a dead program.
    """
    try:
        with in_progress(Deadline.CARD_DRIVER):
            yield
    except DaqNotFoundError as error:
        raise InstrumentError(
            f"{device_name}: the NI-DAQmx driver is not installed on this computer; install it from ni.com/daqmx or with "
            "'python -m nidaqmx installdriver', or choose the simulated bench (in a terminal: --bench sim)"
        ) from error
    except DaqNotSupportedError as error:
        raise InstrumentError(
            f"{device_name}: NI-DAQmx does not run on this computer; use a gRPC server or --bench sim"
        ) from error
    except RpcError as error:
        raise AcquisitionError(
            f"{device_name}: the gRPC device server does not answer ({error.rpc_code}); check that it runs and its address"
        ) from error
    except DaqError as error:
        remedy = REMEDIES.get(error.error_code, "look the number up in NI's help")
        detail = " ".join(str(error).split("\n\n", maxsplit=1)[0].split())
        if error.error_code == RESERVED and remote:
            remedy = REMOTE_RESERVED_REMEDY
        if error.error_code in SCANS_LOST:
            raise ScansLostError(f"{device_name}: {remedy} (NI {error.error_code})") from error
        kind = CardInUseError if error.error_code == RESERVED and not remote else AcquisitionError
        raise kind(f"{device_name}: {remedy} (NI {error.error_code}: {detail[:200]})") from error
