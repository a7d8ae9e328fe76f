"""Simulated phantoms: vessels, tracked ultrasound sweeps over them, models from CT, and the truth behind them."""
