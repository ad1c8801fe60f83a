"""Predictors to decisions: what to expect of a view before anything is taken there."""

from exposight.planning.forecast import WANTED_I_AVG, Forecast, forecast_view
