"""A really measured servo pendulum (BAM XL330): its friction ladder, and planted errors."""
