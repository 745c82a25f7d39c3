"""Evaluation: rollouts on public seeds, statistics, leaderboard, the papers' figures, benchmark."""
