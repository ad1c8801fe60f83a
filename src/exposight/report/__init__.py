"""Results to one HTML page that opens without a network.

A page for any campaign and models (`campaign_report`), the demonstration, the paper's study, the
check of a simulated sensor, and strategies compared.
"""

from exposight.report.campaign_page import CampaignReport, campaign_report, write_campaign_report
from exposight.report.campaign_summary import ModelResult
from exposight.report.comparison_page import comparison_page, write_comparison_page
from exposight.report.demonstration import DemonstrationSettings, run_demonstration
from exposight.report.model_figures import forecast_picture
from exposight.report.part_page import write_part_page
from exposight.report.part_plot import PartMesh, read_part_mesh
from exposight.report.recommendation_figure import recommendation_picture
from exposight.report.reliability_figure import reliability_picture
from exposight.report.sensor_check_page import sensor_check_page, write_sensor_check
from exposight.report.study_page import write_study
