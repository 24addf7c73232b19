from .card import ResultCard as ResultCard
from .card import rich_table as rich_table
from .report_job import ReportJob as ReportJob
