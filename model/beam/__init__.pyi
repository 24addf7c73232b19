from .basis import check_shape_count as check_shape_count
from .basis import shape_functions as shape_functions
from .galerkin import Matrices as Matrices
from .galerkin import gram as gram
from .galerkin import matrices as matrices
from .poles import ModalForm as ModalForm
from .poles import modal_form as modal_form
from .poles import receptance as receptance
