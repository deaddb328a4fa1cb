"""State estimators and predictors: from what was observed to what a controller is to see."""
