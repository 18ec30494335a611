"""LS bus, also named LS INV 485: the ASCII protocol of LS (LSIS, LG) drives. So far its telegrams only."""
