// SPDX-License-Identifier: BSD-3-Clause
#include "python/arrays.h"
#include "python/bind.h"
#include "python/priors.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::python {
namespace {

template <int kRows, int kColumns>
using Matrix = nb::ndarray<const double, nb::shape<kRows, kColumns>, nb::c_contig, nb::device::cpu>;
using Samples = nb::ndarray<const double, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;

template <int kRows, int kColumns>
Eigen::Matrix<double, kRows, kColumns> matrixFrom(const Matrix<kRows, kColumns>& array) {
  using RowMajor = Eigen::Matrix<double, kRows, kColumns, Eigen::RowMajor>;
  return Eigen::Map<const RowMajor>(array.data());
}

void setDepth(Priors& self, nb::handle depth, double sigma, double relative_sigma, bool metric) {
  const AnyArray array = arrayFrom(depth);
  self.priors.depth = denseDepth(depthView(array), sigma, relative_sigma);
  self.priors.depth->metric = metric;
}

void setSparseDepth(Priors& self, int width, int height, const Samples& samples, bool metric) {
  std::vector<DepthAtPixel> all;
  for (std::size_t i = 0; i < samples.shape(0); ++i) {
    const double* row = samples.data() + 4 * i;
    all.push_back({static_cast<float>(row[0]),
                   static_cast<float>(row[1]),
                   static_cast<float>(row[2]),
                   static_cast<float>(row[3])});
  }
  self.priors.depth = sparseDepth(width, height, all);
  self.priors.depth->metric = metric;
}

void setRotation(Priors& self, int since, const Matrix<3, 3>& R, const Matrix<3, 3>& covariance) {
  const Eigen::Matrix3d of_rotation = matrixFrom<3, 3>(covariance);
  self.priors.pose = rotationSince(FrameId{since}, matrixFrom<3, 3>(R), of_rotation);
}

void setPose(Priors& self, int since, const Matrix<4, 4>& T, const Matrix<6, 6>& covariance) {
  const Eigen::Matrix4d matrix = matrixFrom<4, 4>(T);
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  const PosePrior turn = rotationSince(FrameId{since}, R, 1);  // tells what is no rotation
  const Eigen::Vector3d t = matrix.topRightCorner<3, 1>();
  self.priors.pose = poseSince(
      FrameId{since}, SE3(turn.T_frame_since.rotationMatrix(), t), matrixFrom<6, 6>(covariance));
}

void setDistance(Priors& self, int since, double metres, double sigma) {
  self.priors.distance = DistancePrior{FrameId{since}, metres, sigma};
}

void bindDepths(nb::class_<Priors>& type) {
  type.def("set_depth",
           &setDepth,
           nb::arg("depth"),
           nb::arg("sigma") = 0.0,
           nb::arg("relative_sigma") = 0.0,
           nb::arg("metric") = true,
           "(height, width) of float32 along the optical axis [m], NaN or 0 where unknown; the "
           "standard deviation is hypot(sigma, relative_sigma * depth). `metric=False`: right but "
           "for one factor.")
      .def("set_sparse_depth",
           &setSparseDepth,
           nb::arg("width"),
           nb::arg("height"),
           nb::arg("samples"),
           nb::arg("metric") = true,
           "(n, 4) of float64: x, y [px], depth and its standard deviation [m].");
}

}  // namespace

void bindPriors(nb::module_& m) {
  nb::class_<Priors> type(
      m,
      "Priors",
      "What is known of a frame beside its image, for `add` and `process`. Times between frames "
      "are named by the id of the earlier frame.");
  type.def(nb::init<>());
  bindDepths(type);
  bindRepr(type, {});
  type.def("set_rotation",
           &setRotation,
           nb::arg("since"),
           nb::arg("R_frame_since"),
           nb::arg("covariance"),
           "(3, 3): directions of the earlier frame to this one; (3, 3) of a left increment "
           "[rad^2]. Takes the place of set_pose.")
      .def("set_pose",
           &setPose,
           nb::arg("since"),
           nb::arg("T_frame_since"),
           nb::arg("covariance"),
           "(4, 4): coordinates of the earlier camera to this one's [m]; (6, 6) of a left "
           "increment, [translation; rotation]. Takes the place of set_rotation.")
      .def("set_distance",
           &setDistance,
           nb::arg("since"),
           nb::arg("metres"),
           nb::arg("sigma"),
           "Between the two camera centres, with its standard deviation [m].");
}

}  // namespace dsorb::python
