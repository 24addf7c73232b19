from .page import BenchPage as BenchPage
