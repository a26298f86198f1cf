"""From recordings and folders to a session: logs on their control periods, nominal model, deployed controller."""
