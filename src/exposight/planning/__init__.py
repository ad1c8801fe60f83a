"""Predictors to decisions: what to expect of a view before anything is taken there."""

from exposight.planning.forecasts import WANTED_I_AVG, Forecast, forecast
from exposight.planning.sensor_models import DEFAULT_MODELS, ModelScores, SensorModels, train
