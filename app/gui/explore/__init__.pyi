from .page import ExplorePage as ExplorePage
