"""How large and how good a model is, in words."""

from fvs_client.models.snapshots import SnapshotMetrics


def in_words(metrics: SnapshotMetrics) -> str:
    """One line, with every measure of quality that there is."""
    parts = [f"{metrics.registered} images registered"]
    if metrics.unregistered:
        parts.append(f"{metrics.unregistered} unregistered")
    parts.append(f"{metrics.gaussians:,} Gaussians after {metrics.iterations:,} iterations")
    if metrics.psnr_db is not None and metrics.ssim is not None:
        parts.append(f"PSNR {metrics.psnr_db:.2f} dB and SSIM {metrics.ssim:.3f} on images kept from it")
    if metrics.new_images_psnr_db is not None:
        parts.append(f"the model before showed the new images at {metrics.new_images_psnr_db:.2f} dB")
    return ", ".join(parts)
