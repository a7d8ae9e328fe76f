import torch
from torch import nn

from models.inference.ensemble import MeanProbability
from models.networks.outputs import SideOutputs


class Shifted(nn.Module):
    """Logits of the images plus a constant, brighter from left to right."""

    def __init__(self, shift: float, presence: bool = False) -> None:
        super().__init__()
        self.shift = shift
        self.presence = nn.Identity() if presence else None
        self.returns_presence = False

    def forward(self, images: torch.Tensor) -> torch.Tensor | SideOutputs:
        logits = images + self.shift + torch.arange(images.shape[-1])
        return SideOutputs(logits, (), logits.amax(dim=(1, 2, 3))) if self.returns_presence else logits


IMAGES = torch.zeros(2, 1, 3, 4)
RAMP = torch.arange(4.0).expand(2, 1, 3, 4)


def test_probabilities_are_averaged_and_not_logits() -> None:
    (found,) = MeanProbability((Shifted(0.0), Shifted(-3.0)))(IMAGES)
    torch.testing.assert_close(found, (torch.sigmoid(RAMP) + torch.sigmoid(RAMP - 3)) / 2)


def test_of_one_network_it_is_exactly_that_networks_probability() -> None:
    (found,) = MeanProbability((Shifted(0.3),))(IMAGES)
    assert torch.equal(found, torch.sigmoid(RAMP + 0.3))


def test_the_mirror_image_is_turned_back_before_the_mean() -> None:
    (found,) = MeanProbability((Shifted(0.0),), flips=True)(IMAGES)
    torch.testing.assert_close(found, (torch.sigmoid(RAMP) + torch.sigmoid(RAMP.flip(3))) / 2)


def test_presence_is_the_mean_over_the_networks_that_have_it() -> None:
    outputs = MeanProbability((Shifted(0.0, True), Shifted(-3.0, True), Shifted(1.0)))(IMAGES)
    assert len(outputs) == 2
    expected = (torch.sigmoid(torch.tensor(3.0)) + torch.sigmoid(torch.tensor(0.0))) / 2
    torch.testing.assert_close(outputs[1], expected.expand(2))
