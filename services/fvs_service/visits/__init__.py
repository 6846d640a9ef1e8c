"""What vehicles report of views: that they fly there, took the photograph, or could not."""
