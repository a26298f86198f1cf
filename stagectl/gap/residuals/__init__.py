"""What the nominal model leaves unexplained: residuals, sensitivities, and their Gram matrices."""
