"""Networks of the U-Net family."""

from models.networks.registry import RECIPES, NetworkRecipe, recipe_of, settings_of

__all__ = ["RECIPES", "NetworkRecipe", "recipe_of", "settings_of"]
