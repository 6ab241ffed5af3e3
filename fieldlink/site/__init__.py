"""The site file and its register maps as typed, frozen, validated models."""
