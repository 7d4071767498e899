"""Statistical checks that know no estimator."""
