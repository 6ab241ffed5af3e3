"""The last samples of a loop, equally spaced, and the requests for estimates made of them."""
