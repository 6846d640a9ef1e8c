"""ALIKED: learned keypoints and descriptors, independent of SIFT's.

Source: Zhao et al., "ALIKED: A Lighter Keypoint and Descriptor Extraction Network via Deformable
Transformation", IEEE Transactions on Instrumentation and Measurement 72, 2023 (arXiv:2304.03608).
"""
