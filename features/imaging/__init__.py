"""Pictures from any camera: photographs, masks of other tools, foreground, lenses, calibration."""
