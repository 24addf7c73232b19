from .folder_threshold import FolderThreshold as FolderThreshold
from .page import LaboratoryPage as LaboratoryPage
