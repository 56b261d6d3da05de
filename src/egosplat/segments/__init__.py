"""Images cut into regions at three levels (subpart, part, whole), and regions followed from frame to frame."""
