"""What runs on the machines that compute: workers, and the runners of scenes."""
