"""Workers: run jobs from the queue, and keep one runner, a child process with the model, per scene."""
