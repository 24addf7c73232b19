from .log import take_unreported_lines as take_unreported_lines
from .origin import version as version
from .subprocesses import python_command as python_command
from .subprocesses import python_environment as python_environment
from .subprocesses import terminate as terminate
