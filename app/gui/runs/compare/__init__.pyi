from .differences import DifferencesPane as DifferencesPane
from .plot import ComparisonPlot as ComparisonPlot
from .workspace import ComparisonWorkspace as ComparisonWorkspace
