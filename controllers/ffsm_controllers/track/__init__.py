"""Following a site of an object: the approach to a grasp."""
