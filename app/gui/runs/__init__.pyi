from .page import RunsPage as RunsPage
