from .identification_page import IdentificationPage as IdentificationPage
from .identification_page import IdentificationSubject as IdentificationSubject
from .page import SpecimenPage as SpecimenPage
