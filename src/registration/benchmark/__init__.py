"""The frozen benchmark of rigid registration: simulated sweeps, models from CT, and the truth behind both."""
