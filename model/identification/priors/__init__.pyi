from .bounded import near_limit as near_limit
from .bounded import normal_equivalents as normal_equivalents
from .bounded import prior_moments as prior_moments
from .usual import TEMPERATURE_COEFFICIENTS as TEMPERATURE_COEFFICIENTS
from .usual import USUAL_EFFECTS as USUAL_EFFECTS
from .usual import assumed_parameters as assumed_parameters
from .usual import assumed_temperature as assumed_temperature
from .usual import usual_effects as usual_effects
