"""NI-DAQmx errors by number, with NI's messages (nidaqmx.error_codes and NI's help)."""

ERROR_MESSAGES = {
    -200077: "Requested value is not a supported value for this property. The property value may be invalid because it "
    "conflicts with another property.",
    -200081: "Sample rate exceeds the maximum sample rate for the number of channels specified.\n\nReduce the sample rate "
    "or the number of channels.",
    -200088: "Task specified is invalid or does not exist.",
    -200170: "Physical channel specified does not exist on this device.",
    -200220: "Device identifier is invalid.",
    -200278: "Requested read exceeds the total number of samples the task will acquire.",
    -200279: "The application is not able to keep up with the hardware acquisition.\n\nIncreasing the buffer size, reading "
    "the data more frequently, or specifying a fixed number of samples to read instead of reading all available samples "
    "might correct the problem.",
    -200284: "Some or all of the samples requested have not yet been acquired.",
    -89136: "Specified route cannot be satisfied, because the hardware does not support it.",
    -200289: "Attempted to write a sample that has already been generated.",
    -200292: "Some or all of the samples to write could not be written to the buffer yet.",
    -200462: "Generation cannot be started, because not enough samples have been written.",
    -200561: "Attempted writing analog data that is too large or too small.",
    -201132: "Attempted to write samples beyond the final sample of a finite generation.",
    -200452: "Specified property is not supported by the device or is not applicable to the task.",
    -200478: "Specified operation cannot be performed when there are no channels in the task.",
    -200560: "Wait Until Done did not indicate that the task was done within the specified timeout.",
    -200489: "Specified channel cannot be added to the task, because a channel with the same name is already in the task.",
    -201003: "Device cannot be accessed.  Possible causes:\n\nDevice is no longer present in the system.\nDevice is not "
    "powered.",
    -50103: "The specified resource is reserved. The operation could not be completed as specified.",
    -88705: "The specified device is not present or is not active in the system. The device may not be installed on this "
    "system, may have been unplugged, or may not be installed correctly.",
}


class NiError(Exception):
    """An error of NI-DAQmx; `samples_read` is the number of samples read before it."""

    def __init__(self, code: int, detail: str = "", samples_read: int | None = None) -> None:
        super().__init__("\n\n".join(filter(None, (ERROR_MESSAGES[code], detail, f"Status Code: {code}"))))
        self.code = code
        self.samples_read = samples_read
