"""Parts of the elastic Hessian, and the response of bonds to force dipoles."""
