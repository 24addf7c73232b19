from .application import InitialForm as InitialForm
from .application import OpenedBench as OpenedBench
from .application import open_window as open_window
from .display_check import window_unavailable_reason as window_unavailable_reason
