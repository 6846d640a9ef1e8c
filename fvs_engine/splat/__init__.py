"""3D Gaussian splats: model, initialisation, training, rasterising."""
