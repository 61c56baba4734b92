// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/row_times.h"

#include "camera/lens_models.h"

#include <Eigen/QR>

#include <algorithm>

namespace dsorb {
namespace {

constexpr int kFittedPixels = 33;  // along each side of the image, for the fit

using Terms = Eigen::Matrix<double, 1, 10>;

Terms termsAt(double x, double y) {
  return (Terms() << 1, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y)
      .finished();
}

double toUnit(double pixel, int size) {
  return 2 * pixel / (size - 1) - 1;
}

}  // namespace

double RowTimes::at(double x, double y) const {
  const Terms terms = termsAt(toUnit(x, width), toUnit(y, height));
  return readout.seconds * terms.dot(Eigen::Map<const Terms>(share.data()));
}

RowTimes rowTimes(const Lens& lens, const PinholeCamera& camera, bool resampled) {
  RowTimes times{lens.readout, {}, camera.width, camera.height};
  const double max_radius = monotoneRadius(lens);
  const double last = (lens.columns ? lens.width : lens.height) - 1;
  Eigen::Matrix<double, Eigen::Dynamic, 10> terms(kFittedPixels * kFittedPixels, 10);
  Eigen::VectorXd shares(kFittedPixels * kFittedPixels);
  Eigen::Index count = 0;
  for (int i = 0; i < kFittedPixels * kFittedPixels; ++i) {
    const int row = i / kFittedPixels;
    const double a = 2.0 * (i % kFittedPixels) / (kFittedPixels - 1) - 1;
    const double b = 2.0 * row / (kFittedPixels - 1) - 1;
    Eigen::Vector2d pixel(0.5 * (a + 1) * (camera.width - 1), 0.5 * (b + 1) * (camera.height - 1));
    if (resampled) {
      const Eigen::Vector2d ray = camera.unproject(pixel).head<2>();
      if (ray.norm() > max_radius) continue;
      pixel = projectThroughLens(lens, ray);
    }
    const double line = lens.columns ? pixel.x() : pixel.y();
    if (line < 0 || line > last) continue;  // invalid pixels
    terms.row(count) = termsAt(a, b);
    shares[count++] = lens.backwards ? 0.5 - line / last : line / last - 0.5;
  }
  const Eigen::VectorXd fit = terms.topRows(count).colPivHouseholderQr().solve(shares.head(count));
  std::copy_n(fit.data(), fit.size(), times.share.data());
  return times;
}

}  // namespace dsorb
