"""Results to one HTML page that opens without a network.

Here is what every page is made of; `door`, `skull` and `study` have a page each.
"""

from exposight.report.page import write_report
