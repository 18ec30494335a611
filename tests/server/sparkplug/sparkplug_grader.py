"""The grader with all of its checks."""

import checks_of_connections
import checks_of_messages
import checks_of_metrics
from sparkplug_grading import CHECKS, Report, Seen, graded

PARTS = (checks_of_messages, checks_of_metrics, checks_of_connections)

__all__ = ["CHECKS", "PARTS", "Report", "Seen", "graded"]
