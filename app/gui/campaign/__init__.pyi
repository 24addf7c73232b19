from .controller import CampaignController as CampaignController
from .page import CampaignPage as CampaignPage
