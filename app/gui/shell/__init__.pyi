from .main_window import InitialForm as InitialForm
from .main_window import MainWindow as MainWindow
from .page_host import BENCH as BENCH
