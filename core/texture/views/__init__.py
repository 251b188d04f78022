"""Which photo shows what of the scan, how sharp, in which colours; and which face takes which photo."""
