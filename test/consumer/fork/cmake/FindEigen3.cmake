# SPDX-License-Identifier: BSD-3-Clause
# As DSO and hundreds of others have one: it knows neither Eigen's version nor its target.
find_path(EIGEN3_INCLUDE_DIR Eigen/Core PATH_SUFFIXES eigen3)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Eigen3 DEFAULT_MSG EIGEN3_INCLUDE_DIR)
