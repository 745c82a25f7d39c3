"""Training with stable-baselines3: `python -m train.sb3 --help`."""
