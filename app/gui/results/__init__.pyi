from .card import ResultCard as ResultCard
from .report_job import ReportJob as ReportJob
