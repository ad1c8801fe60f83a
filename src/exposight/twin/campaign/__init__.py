"""A plan carried out: views taken as tasks, captures or observations kept, gone on with."""

from exposight.twin.campaign.record import PLAN_FILE, RECORD_FILE, scene_checksum
from exposight.twin.campaign.settings import CellSettings
from exposight.twin.campaign.simulated_cell import simulate, simulate_observations
from exposight.twin.campaign.view_captures import OBSERVATIONS_FILE, scene_at
from exposight.twin.campaign.view_tables import ViewTables, count_views, views_folder
