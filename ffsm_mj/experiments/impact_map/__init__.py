"""Impact map: what one contact does to robot and object, over the configurations of the arm that reach it."""
