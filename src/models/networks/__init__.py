"""Networks of the U-Net family."""

from models.networks.registry import NetworkRecipe, recipe_of, recipes, settings_of

__all__ = ["NetworkRecipe", "recipe_of", "recipes", "settings_of"]
