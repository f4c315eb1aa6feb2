"""What has changed since a twin was healthy: every cause is judged by one score on all that was recorded."""
