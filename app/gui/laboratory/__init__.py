"""Laboratory page: many specimens, control charts, calibration certificates and audit trail."""
