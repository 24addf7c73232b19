from .design import AddedMassTopic as AddedMassTopic
from .design import DriveTopic as DriveTopic
from .design import PowerTopic as PowerTopic
