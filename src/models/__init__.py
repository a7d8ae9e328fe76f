"""From ultrasound image to vessel probability to binary mask: torch and lightning, nothing of the tracker."""
