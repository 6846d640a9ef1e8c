"""Matter of a trained model: what its opaque Gaussians show to be solid."""

from fvs_engine.plan.clearance import Matter
from fvs_engine.splat.gaussians import Gaussians


def matter_of(gaussians: Gaussians) -> Matter:
    """Matter of Gaussians, in their frame, on any device."""
    return Matter.of_model(
        gaussians.means.detach().cpu().numpy(),
        gaussians.log_scales.detach().exp().cpu().numpy(),
        gaussians.opacity_logits.detach().sigmoid().cpu().numpy(),
    )
