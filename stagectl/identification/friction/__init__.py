"""The family of friction models, fitted by one code and run again in closed loop; `method` is where it begins."""
