"""What a plant has without a valve model: PI, and an offset-free MPC."""
