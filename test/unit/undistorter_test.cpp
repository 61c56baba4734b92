// SPDX-License-Identifier: BSD-3-Clause
#include "camera/undistorter.h"

#include "camera/lens_models.h"

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <ostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

Lens euroc() {
  return {LensModel::kRadTan,
          458.654,
          457.296,
          367.215,
          248.375,
          {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0},
          752,
          480};
}
Lens freiburg1() {
  return {LensModel::kRadTan,
          517.306408,
          516.469215,
          318.643040,
          255.313989,
          {0.262383, -0.953104, -0.005358, 0.002628, 1.163314},
          640,
          480};
}
/// 138 degrees over the diagonal.
Lens fisheye() {
  return {
      LensModel::kEquidistant, 300, 300, 254.9, 256.9, {0.0034, 0.0007, -0.002, 0.0002}, 512, 512};
}
/// More than 180 degrees over the diagonal, as that of TUM-VI.
Lens wideFisheye() {
  Lens lens = fisheye();
  lens.fx = lens.fy = 190.9;
  return lens;
}
Lens tumMono() {
  return {LensModel::kFov, 343, 343, 315, 256, {0.9, 0, 0, 0, 0}, 640, 512};
}
/// As of an Azure Kinect.
Lens rational() {
  return {LensModel::kRational,
          605,
          605,
          638,
          366,
          {0.52, -2.6, 0.0004, -0.0003, 1.5, 0.40, -2.43, 1.43},
          1280,
          720};
}
Lens doubleSphere() {
  return {LensModel::kDoubleSphere, 250, 250.1, 254.9, 256.9, {-0.172, 0.593}, 512, 512};
}
Lens extendedUnified() {
  return {LensModel::kExtendedUnified, 300, 300.1, 254.9, 256.9, {0.63, 1.04}, 512, 512};
}
Lens unified() {
  return {LensModel::kUnified,
          1002.5,
          1005.4,
          325.3,
          236.6,
          {2.04, -0.11, 0.45, -0.0004, -0.0003},
          640,
          480};
}
Lens pinhole() {
  return {LensModel::kPinhole, 528, 530, 325.3, 236.6, {}, 640, 480};
}

struct NamedLens {
  std::string name;
  Lens lens;
};

void PrintTo(const NamedLens& named, std::ostream* stream) {
  *stream << named.name;
}

class EveryLensTest : public testing::TestWithParam<NamedLens> {};

Rectification wanted(RectificationMode mode, int width = 0, int height = 0) {
  return {mode, width, height, {}};
}

/// What an all-valid input turns into: values of a constant image, or NaN.
std::vector<float> rectifiedConstant(const Undistorter& undistorter) {
  const std::vector<float> input(
      static_cast<std::size_t>(undistorter.inputWidth() * undistorter.inputHeight()), 100.0F);
  std::vector<float> output(
      static_cast<std::size_t>(undistorter.camera().width * undistorter.camera().height));
  undistorter.apply(input.data(), output.data());
  return output;
}

std::ptrdiff_t invalidPixels(const Undistorter& undistorter) {
  const auto output = rectifiedConstant(undistorter);
  return std::count_if(output.begin(), output.end(), [](float v) { return std::isnan(v); });
}

TEST(LensModelsTest, RadialTangentialAgreesWithOpenCv) {
  const Lens lens = freiburg1();
  const cv::Matx33d K(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
  const std::vector<double> coefficients(lens.coefficients.begin(), lens.coefficients.end());
  for (double x = -0.6; x <= 0.6; x += 0.1) {
    for (double y = -0.5; y <= 0.5; y += 0.1) {
      std::vector<cv::Point2d> expected;
      cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}},
                        cv::Vec3d(0, 0, 0),
                        cv::Vec3d(0, 0, 0),
                        K,
                        coefficients,
                        expected);
      const Eigen::Vector2d pixel = projectThroughLens(lens, {x, y});
      EXPECT_NEAR(pixel.x(), expected[0].x, 1e-9);
      EXPECT_NEAR(pixel.y(), expected[0].y, 1e-9);
    }
  }
}

TEST(LensModelsTest, EquidistantAgreesWithOpenCv) {
  const Lens lens = fisheye();
  const cv::Matx33d K(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
  const cv::Vec4d k(lens.coefficients.data());
  for (double x = -2; x <= 2; x += 0.4) {
    for (double y = -2; y <= 2; y += 0.4) {
      std::vector<cv::Point2d> expected;
      cv::fisheye::distortPoints(std::vector<cv::Point2d>{{x, y}}, expected, K, k);
      const Eigen::Vector2d pixel = projectThroughLens(lens, {x, y});
      EXPECT_NEAR(pixel.x(), expected[0].x, 1e-9);
      EXPECT_NEAR(pixel.y(), expected[0].y, 1e-9);
    }
  }
}

TEST(LensModelsTest, FieldOfViewModelAgreesWithItsPublishedInverse) {
  // The published inverse: r = tan(r_d omega) / (2 tan(omega / 2)).
  const Lens lens = tumMono();
  const double omega = lens.coefficients[0];
  for (double distorted = 0.05; distorted < 1; distorted += 0.05) {
    const double ideal = std::tan(distorted * omega) / (2 * std::tan(omega / 2));
    const Eigen::Vector2d pixel = projectThroughLens(lens, {0.6 * ideal, -0.8 * ideal});
    EXPECT_NEAR(pixel.x(), lens.fx * 0.6 * distorted + lens.cx, 1e-9);
    EXPECT_NEAR(pixel.y(), -lens.fy * 0.8 * distorted + lens.cy, 1e-9);
  }
}

TEST(LensModelsTest, FieldOfViewModelWithoutAngleIsAPinhole) {
  Lens lens = tumMono();
  lens.coefficients[0] = 0;
  EXPECT_NEAR(projectThroughLens(lens, {0.5, 0}).x(), 0.5 * lens.fx + lens.cx, 1e-12);
}

TEST(LensModelsTest, RationalAgreesWithOpenCv) {
  const Lens lens = rational();
  const cv::Matx33d K(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
  const std::vector<double> coefficients(lens.coefficients.begin(), lens.coefficients.end());
  for (double x = -1; x <= 1; x += 0.1) {
    for (double y = -0.6; y <= 0.6; y += 0.1) {
      std::vector<cv::Point2d> expected;
      cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}},
                        cv::Vec3d(0, 0, 0),
                        cv::Vec3d(0, 0, 0),
                        K,
                        coefficients,
                        expected);
      const Eigen::Vector2d pixel = projectThroughLens(lens, {x, y});
      EXPECT_NEAR(pixel.x(), expected[0].x, 1e-9);
      EXPECT_NEAR(pixel.y(), expected[0].y, 1e-9);
    }
  }
}

/// Ray of length 1 of a point (mx, my) before fx, fy, cx, cy, by the closed forms.
/// @source Usenko et al., "The Double Sphere Camera Model", 3DV 2018, eqs. (46) and (19)
Eigen::Vector3d publishedRay(const Lens& lens, double mx, double my) {
  const double r2 = mx * mx + my * my;
  if (lens.model == LensModel::kExtendedUnified) {
    const double alpha = lens.coefficients[0], beta = lens.coefficients[1];
    const double mz = (1 - beta * alpha * alpha * r2) /
                      (alpha * std::sqrt(1 - (2 * alpha - 1) * beta * r2) + (1 - alpha));
    return Eigen::Vector3d(mx, my, mz).normalized();
  }
  const double xi = lens.coefficients[0], alpha = lens.coefficients[1];
  const double mz =
      (1 - alpha * alpha * r2) / (alpha * std::sqrt(1 - (2 * alpha - 1) * r2) + 1 - alpha);
  const double share = (mz * xi + std::sqrt(mz * mz + (1 - xi * xi) * r2)) / (mz * mz + r2);
  return share * Eigen::Vector3d(mx, my, mz) - Eigen::Vector3d(0, 0, xi);
}

TEST(LensModelsTest, SphericalModelsAgreeWithTheirPublishedInverses) {
  for (const Lens& lens : {doubleSphere(), extendedUnified()}) {
    for (double x = 20; x < lens.width; x += 60) {
      for (double y = 100; y < lens.height - 100; y += 60) {
        const Eigen::Vector3d ray =
            publishedRay(lens, (x - lens.cx) / lens.fx, (y - lens.cy) / lens.fy);
        if (ray.z() < 0.1) continue;
        const Eigen::Vector2d pixel = projectThroughLens(lens, ray.head<2>() / ray.z());
        EXPECT_NEAR(pixel.x(), x, 1e-9);
        EXPECT_NEAR(pixel.y(), y, 1e-9);
      }
    }
  }
}

TEST(LensModelsTest, UnifiedProjectsFromTheSphere) {
  const Lens lens = unified();
  const Eigen::Vector3d point(0.3, -0.4, 0.8);
  const Eigen::Vector3d sphere = point.normalized() + Eigen::Vector3d(0, 0, lens.coefficients[0]);
  const Lens distortion{
      LensModel::kRadTan,
      lens.fx,
      lens.fy,
      lens.cx,
      lens.cy,
      {lens.coefficients[1], lens.coefficients[2], lens.coefficients[3], lens.coefficients[4]}};
  const Eigen::Vector2d expected = projectThroughLens(distortion, sphere.head<2>() / sphere.z());
  const Eigen::Vector2d pixel = projectThroughLens(lens, point.head<2>() / point.z());
  EXPECT_NEAR((pixel - expected).norm(), 0, 1e-9);
}

TEST_P(EveryLensTest, TheInverseChangesAsTheProjectionDoes) {
  const Lens& lens = GetParam().lens;
  const double max_radius = monotoneRadius(lens);
  const double step = 1e-3;
  const Eigen::Vector2d pixel(0.6 * lens.width, 0.3 * lens.height);
  Eigen::Matrix2d J_pixel, J_ray;
  const Eigen::Vector2d ray = rayOfPixel(lens, pixel, max_radius);
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d off = step * Eigen::Vector2d::Unit(axis);
    J_pixel.col(axis) =
        (rayOfPixel(lens, pixel + off, max_radius) - rayOfPixel(lens, pixel - off, max_radius)) /
        (2 * step);
    J_ray.col(axis) =
        (projectThroughLens(lens, ray + off) - projectThroughLens(lens, ray - off)) / (2 * step);
  }
  EXPECT_LT((J_ray * J_pixel - Eigen::Matrix2d::Identity()).norm(), 1e-4);
}

/// A turned lens sees along a turned ray the turned pixel.
TEST_P(EveryLensTest, ATurnedLensSeesWhatTheTurnedImageShows) {
  Calibration calibration;
  calibration.lens = GetParam().lens;
  const Lens& lens = calibration.lens;
  const Eigen::Vector2d ray(0.21, -0.13);
  const Eigen::Vector2d pixel = projectThroughLens(lens, ray);
  const double last_x = lens.width - 1, last_y = lens.height - 1;
  const Lens right = turned(calibration, 90).lens;
  EXPECT_EQ(right.width, lens.height);
  EXPECT_LT((projectThroughLens(right, {-ray.y(), ray.x()}) -
             Eigen::Vector2d(last_y - pixel.y(), pixel.x()))
                .norm(),
            1e-9);
  const Lens over = turned(calibration, 180).lens;
  EXPECT_LT((projectThroughLens(over, -ray) - Eigen::Vector2d(last_x, last_y) + pixel).norm(),
            1e-9);
  const Lens left = turned(calibration, 270).lens;
  EXPECT_LT((projectThroughLens(left, {ray.y(), -ray.x()}) -
             Eigen::Vector2d(pixel.y(), last_x - pixel.x()))
                .norm(),
            1e-9);
}

TEST(TurnedCalibration, VignetteReadoutAndOutputCameraTurnToo) {
  Calibration calibration;
  calibration.lens = {LensModel::kPinhole, 50, 60, 20, 10, {}, 48, 32};
  calibration.lens.readout.seconds = 0.01;
  calibration.rectification = {RectificationMode::kExplicit, 32, 16, {30, 40, 12, 5, 0, 0}};
  calibration.photometric.vignette = {1, 2, 3, 4, 5, 6};
  calibration.photometric.vignette_width = 3;
  calibration.photometric.vignette_height = 2;
  const Calibration right = turned(calibration, 90);
  EXPECT_EQ(right.photometric.vignette, (std::vector<float>{4, 1, 5, 2, 6, 3}));
  EXPECT_EQ(right.photometric.vignette_width, 2);
  EXPECT_TRUE(right.lens.columns && right.lens.backwards);
  EXPECT_EQ(right.rectification.width, 16);
  EXPECT_EQ(right.rectification.camera.fx, 40);
  EXPECT_EQ(right.rectification.camera.cx, 10);
  EXPECT_EQ(right.rectification.camera.cy, 12);
  const Lens over = turned(calibration, 180).lens;
  EXPECT_TRUE(!over.columns && over.backwards);
  const Lens round = turned(turned(calibration, 180), 180).lens;
  EXPECT_TRUE(!round.columns && !round.backwards);
  EXPECT_EQ(round.cx, 20);
}

TEST_P(EveryLensTest, RayOfPixelInvertsTheLens) {
  const Lens& lens = GetParam().lens;
  const double max_radius = monotoneRadius(lens);
  for (int v = 40; v < lens.height; v += 40) {
    for (int u = 40; u < lens.width; u += 40) {
      const Eigen::Vector2d pixel(u, v);
      const Eigen::Vector2d ray = rayOfPixel(lens, pixel, max_radius);
      EXPECT_NEAR((projectThroughLens(lens, ray) - pixel).norm(), 0, 1e-7) << u << " " << v;
    }
  }
}

TEST_P(EveryLensTest, CropLeavesNoInvalidPixel) {
  const Undistorter undistorter(GetParam().lens, wanted(RectificationMode::kCrop));
  EXPECT_EQ(invalidPixels(undistorter), 0);
}

TEST_P(EveryLensTest, CropTakesAllThatIsValid) {
  const Lens& lens = GetParam().lens;
  const PinholeCamera crop = Undistorter(lens, wanted(RectificationMode::kCrop)).camera();
  // Any side moved outwards by a pixel meets invalid ones.
  for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
    Rectification moved = wanted(RectificationMode::kExplicit, crop.width, crop.height);
    moved.camera = crop;
    moved.camera.cx += dx;
    moved.camera.cy += dy;
    EXPECT_GT(invalidPixels(Undistorter(lens, moved)), 0) << "moved by " << dx << " " << dy;
  }
}

TEST_P(EveryLensTest, FullShowsTheCornersOfTheInput) {
  const Lens& lens = GetParam().lens;
  const Undistorter undistorter(lens, wanted(RectificationMode::kFull));
  const PinholeCamera& camera = undistorter.camera();
  const double max_radius = monotoneRadius(lens);
  for (const double u : {0.0, lens.width - 1.0}) {
    for (const double v : {0.0, lens.height - 1.0}) {
      const Eigen::Vector2d ray = rayOfPixel(lens, {u, v}, max_radius);
      const Eigen::Vector2d pixel = camera.project({ray.x(), ray.y(), 1});
      EXPECT_TRUE(camera.contains(pixel, -1e-6)) << pixel.transpose();
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Lenses,
                         EveryLensTest,
                         testing::Values(NamedLens{"Pinhole", pinhole()},
                                         NamedLens{"Euroc", euroc()},
                                         NamedLens{"Freiburg1", freiburg1()},
                                         NamedLens{"Fisheye", fisheye()},
                                         NamedLens{"TumMono", tumMono()},
                                         NamedLens{"Rational", rational()},
                                         NamedLens{"DoubleSphere", doubleSphere()},
                                         NamedLens{"ExtendedUnified", extendedUnified()},
                                         NamedLens{"Unified", unified()}),
                         [](const auto& test) { return test.param.name; });

TEST(UndistorterTest, FullMarksWhatLiesOutsideAsInvalidAndKeepsTheRest) {
  const Undistorter undistorter(euroc(), wanted(RectificationMode::kFull));
  const auto output = rectifiedConstant(undistorter);
  const auto invalid = invalidPixels(undistorter);
  EXPECT_GT(invalid, 0);
  EXPECT_LT(invalid, static_cast<std::ptrdiff_t>(output.size()) / 3);
  for (const float value : output) {
    EXPECT_TRUE(std::isnan(value) || std::abs(value - 100) < 1e-3) << value;
  }
}

TEST(UndistorterTest, LensesBeyondAHemisphereAreCutAtTheLargestRay) {
  const PinholeCamera full = Undistorter(wideFisheye(), wanted(RectificationMode::kFull)).camera();
  EXPECT_NEAR(full.unproject({0, 0}).x(), -kMaxRay, 1e-9);
  EXPECT_NEAR(full.unproject({full.width - 1.0, 0}).x(), kMaxRay, 1e-9);
  const Undistorter crop(wideFisheye(), wanted(RectificationMode::kCrop));
  EXPECT_EQ(invalidPixels(crop), 0);
  EXPECT_GE(crop.camera().unproject({0, 0}).x(), -kMaxRay);
}

TEST(UndistorterTest, NoneCopiesPixelsAndCropsRightAndBelowToMultiplesOf16) {
  Lens lens{LensModel::kPinhole, 718.9, 718.9, 607.2, 185.2, {}, 1241, 376};
  const Undistorter undistorter(lens, wanted(RectificationMode::kNone));
  const PinholeCamera& camera = undistorter.camera();
  EXPECT_EQ(camera.width, 1232);
  EXPECT_EQ(camera.height, 368);
  EXPECT_EQ(camera.fx, lens.fx);
  EXPECT_EQ(camera.cx, lens.cx);
  EXPECT_EQ(camera.cy, lens.cy);
  std::vector<float> input(1241 * 376);
  for (std::size_t i = 0; i < input.size(); ++i) input[i] = static_cast<float>(i);
  std::vector<float> output(1232 * 368);
  undistorter.apply(input.data(), output.data());
  EXPECT_EQ(output[0], 0);
  EXPECT_EQ(output[1231], 1231);
  EXPECT_EQ(output[367 * 1232 + 5], 367 * 1241 + 5);
}

TEST(UndistorterTest, NoneIsForImagesWithoutADistortion) {
  for (const Lens& lens : {euroc(), fisheye(), tumMono(), doubleSphere()}) {
    EXPECT_THROW(Undistorter(lens, wanted(RectificationMode::kNone)), std::invalid_argument);
  }
  Lens plain = euroc();
  plain.coefficients = {};
  EXPECT_EQ(Undistorter(plain, wanted(RectificationMode::kNone)).camera().fx, plain.fx);
}

TEST(UndistorterTest, SizesOfKittiSequencesGetFiveLevels) {
  Lens lens{LensModel::kPinhole, 707.1, 707.1, 601.9, 183.1, {}, 1226, 370};
  const PinholeCamera camera = Undistorter(lens, wanted(RectificationMode::kNone)).camera();
  EXPECT_EQ(camera.width, 1216);
  EXPECT_EQ(camera.height, 368);
}

TEST(UndistorterTest, ExplicitWithTheSameCameraIsTheIdentity) {
  const Lens lens = pinhole();
  Rectification same = wanted(RectificationMode::kExplicit, 640, 480);
  same.camera = {lens.fx, lens.fy, lens.cx, lens.cy, 0, 0};
  const Undistorter undistorter(lens, same);
  std::vector<float> input(640 * 480);
  for (std::size_t i = 0; i < input.size(); ++i) input[i] = static_cast<float>((i * 37) % 256);
  std::vector<float> output(640 * 480);
  undistorter.apply(input.data(), output.data());
  for (std::size_t i = 0; i < input.size(); ++i) ASSERT_NEAR(output[i], input[i], 1e-3) << i;
}

TEST(UndistorterTest, CropOfAPinholeIsTheIdentityToo) {
  const Lens lens = pinhole();
  const PinholeCamera camera = Undistorter(lens, wanted(RectificationMode::kCrop)).camera();
  EXPECT_NEAR(camera.fx, lens.fx, 1e-4);
  EXPECT_NEAR(camera.fy, lens.fy, 1e-4);
  EXPECT_NEAR(camera.cx, lens.cx, 1e-4);
  EXPECT_NEAR(camera.cy, lens.cy, 1e-4);
}

TEST(UndistorterTest, EachPixelShowsWhatTheLensSeesAlongItsRay) {
  const Lens lens = euroc();
  const Undistorter undistorter(lens, wanted(RectificationMode::kCrop));
  const PinholeCamera& camera = undistorter.camera();
  // Bilinear interpolation is exact on a plane of grey levels: the image of u + 2 v.
  std::vector<float> input(752 * 480);
  for (int v = 0; v < 480; ++v) {
    for (int u = 0; u < 752; ++u) {
      input[static_cast<std::size_t>(v * 752 + u)] = static_cast<float>(u + 2 * v);
    }
  }
  std::vector<float> output(752 * 480);
  undistorter.apply(input.data(), output.data());
  for (int y = 0; y < camera.height; y += 13) {
    for (int x = 0; x < camera.width; x += 17) {
      const Eigen::Vector3d ray = camera.unproject({x, y});
      const Eigen::Vector2d seen = projectThroughLens(lens, ray.head<2>());
      // Float positions and sums up to 1700.
      ASSERT_NEAR(output[static_cast<std::size_t>(y * 752 + x)], seen.x() + 2 * seen.y(), 2e-3);
    }
  }
}

TEST(UndistorterTest, ReducingAveragesInsteadOfPickingPixels) {
  Lens lens{LensModel::kPinhole, 1000, 1000, 639.5, 511.5, {}, 1280, 1024};
  Rectification half = wanted(RectificationMode::kExplicit, 640, 512);
  half.camera = {500, 500, 319.5, 255.5, 0, 0};
  const Undistorter undistorter(lens, half);
  std::vector<float> input(1280 * 1024);
  for (std::size_t i = 0; i < input.size(); ++i) input[i] = i % 2 == 0 ? 0.0F : 200.0F;
  std::vector<float> output(640 * 512);
  undistorter.apply(input.data(), output.data());
  for (int y = 2; y < 510; ++y) {
    for (int x = 2; x < 638; ++x) {
      ASSERT_NEAR(output[static_cast<std::size_t>(y * 640 + x)], 100, 1e-2) << x << " " << y;
    }
  }
}

TEST(UndistorterTest, InvalidInputPixelsStayInvalid) {
  const Undistorter undistorter(euroc(), wanted(RectificationMode::kCrop));
  std::vector<float> input(752 * 480, 50.0F);
  const Eigen::Vector2d seen =
      projectThroughLens(euroc(), undistorter.camera().unproject({300, 200}).head<2>());
  const auto index = static_cast<std::size_t>(std::lround(seen.y()) * 752 + std::lround(seen.x()));
  input[index] = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> output(752 * 480);
  undistorter.apply(input.data(), output.data());
  EXPECT_TRUE(std::isnan(output[200 * 752 + 300]));
  const auto invalid =
      std::count_if(output.begin(), output.end(), [](float v) { return std::isnan(v); });
  EXPECT_LE(invalid, 9);
}

TEST(UndistorterTest, RaysBeyondTheFoldOfAPolynomialAreInvalid) {
  // r (1 - 0.3 r^2) has its maximum at r = 1.054; further out it comes back into the image.
  Lens lens{LensModel::kRadTan, 300, 300, 319.5, 239.5, {-0.3, 0, 0, 0, 0}, 640, 480};
  EXPECT_NEAR(monotoneRadius(lens), std::sqrt(1 / 0.9), 2e-3);
  Rectification wide = wanted(RectificationMode::kExplicit, 640, 480);
  wide.camera = {100, 100, 319.5, 239.5, 0, 0};
  const Undistorter undistorter(lens, wide);
  const auto output = rectifiedConstant(undistorter);
  const auto at = [&](int x, int y) { return output[static_cast<std::size_t>(y * 640 + x)]; };
  EXPECT_FALSE(std::isnan(at(319 + 80, 239)));
  EXPECT_TRUE(std::isnan(at(319 + 120, 239)));
  EXPECT_TRUE(std::isnan(at(319 + 182, 239)));  // would see the principal point again
  const Undistorter crop(lens, wanted(RectificationMode::kCrop));
  EXPECT_EQ(invalidPixels(crop), 0);
}

TEST(UndistorterTest, RefusesNumbersThatMakeNoCamera) {
  const Rectification crop = wanted(RectificationMode::kCrop);
  Lens negative = euroc();
  negative.fx = -1;
  EXPECT_THROW(Undistorter(negative, crop), std::invalid_argument);
  Lens unknown = euroc();
  unknown.coefficients[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(Undistorter(unknown, crop), std::invalid_argument);
  Lens outside = euroc();
  outside.cx = 900;
  EXPECT_THROW(Undistorter(outside, crop), std::invalid_argument);
  Lens empty = euroc();
  empty.width = 0;
  EXPECT_THROW(Undistorter(empty, crop), std::invalid_argument);
  EXPECT_THROW(Undistorter(euroc(), wanted(RectificationMode::kNone, 640, 480)),
               std::invalid_argument);
  EXPECT_THROW(Undistorter(euroc(), wanted(RectificationMode::kCrop, 15, 480)),
               std::invalid_argument);
}

TEST(Undistorter, CropEndsWhereThePrincipalPointLiesOnTheEdgeOfTheImage) {
  const Lens left{LensModel::kRadTan, 200, 200, 0, 119.5, {-0.28, 0.07, 0, 0, 0}, 320, 240};
  Lens top = left;
  top.cx = 159.5;
  top.cy = 0;
  const Lens right{LensModel::kEquidistant, 200, 200, 319, 119.5, {-0.02, 0.01, 0, 0, 0}, 320, 240};
  const Lens undistorted{LensModel::kPinhole, 200, 200, 0, 119.5, {}, 320, 240};
  for (const Lens& lens : {left, top, right, undistorted}) {
    const PinholeCamera camera = Undistorter(lens, {}).camera();
    const double edge = lens.cx == 0   ? camera.cx
                        : lens.cy == 0 ? camera.cy
                                       : camera.width - 1 - camera.cx;
    EXPECT_NEAR(edge, 0, 1e-6);
    EXPECT_GT(camera.fx, 50);
    EXPECT_LT(camera.fx, 300);
  }
}

TEST(Undistorter, ImagesOfMoreThanTheirMegapixelsAreRefused) {
  Rectification wanted;
  wanted.width = wanted.height = 65536;
  try {
    const Undistorter undistorter(pinhole(), wanted);
    ADD_FAILURE() << "nothing was thrown";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "output size 65536x65536: at most 64 megapixels are expected");
  }
}

}  // namespace
}  // namespace dsorb
