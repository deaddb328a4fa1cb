"""``steersman live``: a page on which each change of a setting drives again."""
