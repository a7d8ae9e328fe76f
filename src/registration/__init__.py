"""From tracked ultrasound frames to a vessel surface aligned to CT: geometry only, no learning, no tracking."""
