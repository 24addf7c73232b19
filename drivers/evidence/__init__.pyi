from .assumption import Assumption as Assumption
from .assumption import OutputCheck as OutputCheck
from .evidence_files import assumptions_about as assumptions_about
from .evidence_files import assumptions_about_card as assumptions_about_card
