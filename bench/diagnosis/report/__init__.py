"""The report page of a diagnosis: one file that shows what was found, and on what grounds."""

from .page import Origin, report_page, write_report
from .traces import Trace, traces_of

__all__ = ["Origin", "Trace", "report_page", "traces_of", "write_report"]
