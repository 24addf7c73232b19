from .exercise import Trace as Trace
from .messages import MessageLog as MessageLog
from .procedure import commission_bench as commission_bench
from .sequence import Commissioned as Commissioned
from .verdict import CheckedOutput as CheckedOutput
from .verdict import OutputVerdict as OutputVerdict
from .verdict import checked_assumptions as checked_assumptions
from .verdict import worst_verdict as worst_verdict
