"""Plant-wide events of the tuning family."""
__all__ = ["draw_event"]
def draw_event():
    raise NotImplementedError
