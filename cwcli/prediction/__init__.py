"""Where a vehicle will be: motion models, rollout of paths with their covariance, errors against actual positions."""
