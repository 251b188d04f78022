"""Colours that agree: gains, seams levelled and blended, colour charts."""
