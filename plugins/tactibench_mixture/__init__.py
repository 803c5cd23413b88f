"""A model that says where contacts are and how sure it is: a mixture of Gaussians per frame."""
