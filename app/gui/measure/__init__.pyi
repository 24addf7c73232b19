from .page import MeasurePage as MeasurePage
from .presets import PresetStore as PresetStore
from .presets import presets_path as presets_path
from .run_panel import OperatorOfToday as OperatorOfToday
from .run_panel import RunPanel as RunPanel
