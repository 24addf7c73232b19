from .diagnosis import diagnose as diagnose
from .evidence import Evidence as Evidence
from .explanation import Diagnosis as Diagnosis
from .undecidable import UndecidableError as UndecidableError
from .undecidable import undecidable_errors as undecidable_errors
