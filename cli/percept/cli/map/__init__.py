"""`percept map`: HD maps, by themselves and against the road."""
