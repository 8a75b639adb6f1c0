"""What every daemon's shell is made of: arguments, real-time set-up, notification, health, shutdown."""
