"""Predictors to decisions: what to expect of a view before anything is taken there."""

from exposight.planning.forecasts import LIKELY, WANTED_BRIGHTNESS, Forecast, chained_forecast
from exposight.planning.sensor_models import DEFAULT_MODELS, ModelScores, SensorModels, train
