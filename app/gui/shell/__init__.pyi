from .garbage_collection import collect_garbage_here as collect_garbage_here
from .main_window import InitialForm as InitialForm
from .main_window import MainWindow as MainWindow
from .page_host import BENCH as BENCH
