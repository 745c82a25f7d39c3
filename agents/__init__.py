"""Things that fly: classical laws and learned policies, all with SB3's `predict`."""
