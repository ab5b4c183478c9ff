"""LiDARs placed on one of them: pairs, hypotheses, votes, the rig graph."""
