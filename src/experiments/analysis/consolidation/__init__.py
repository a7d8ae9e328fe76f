"""One model from the folds: candidates, their calibration and thresholds, and the certificate of the choice."""
