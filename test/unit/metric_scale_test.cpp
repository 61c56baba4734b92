// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/metric_scale.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <stdexcept>
#include <vector>

namespace dsorb {
namespace {

constexpr int kWidth = 96;
constexpr int kHeight = 64;
constexpr double kMetres = 2.5;  // of a unit, the truth
constexpr double kSigma = .02;   // relative, of points and of depths each

FramePtr greyFrame(int id) {
  const std::vector<float> pixels(static_cast<std::size_t>(kWidth) * kHeight, 100);
  return Frame::create({pixels.data(), kWidth, kHeight}, {FrameId{id}, .1 * id});
}

/// A start and an image of depths at its reference, both with noise.
struct Scene {
  InitializationResult result;
  std::vector<float> depth;

  explicit Scene(unsigned seed) : depth(static_cast<std::size_t>(kWidth) * kHeight, 0) {
    result.frames.push_back({greyFrame(0), SE3(), {}, std::nullopt});
    const SE3 moved(Eigen::Matrix3d::Identity(), Eigen::Vector3d(.3, 0, .4));
    result.frames.push_back({greyFrame(1), moved, {}, Matrix6d::Identity() * 1e-4});
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, kSigma);
    for (int y = 4; y < kHeight - 4; y += 4) {
      for (int x = 4; x < kWidth - 4; x += 4) {
        const double truth = .5 + x * .01 + y * .005;  // inverse depth [1/unit]
        const auto found = static_cast<float>(truth * std::exp(noise(random)));
        const auto variance = static_cast<float>(truth * truth * kSigma * kSigma);
        const Eigen::Vector2f pixel(static_cast<float>(x), static_cast<float>(y));
        result.points.push_back({0, pixel, found, variance, 2});
        at(x, y) = static_cast<float>(kMetres / truth * std::exp(noise(random)));
      }
    }
  }

  float& at(int x, int y) { return depth[static_cast<std::size_t>(y * kWidth + x)]; }
  [[nodiscard]] KnownDepth known(double sigma = kSigma) const {
    return {{depth.data(), kWidth, kHeight}, 0, sigma};
  }
};

double squaredError(const MetricScale& scale) {
  const double error = std::log(scale.metres / kMetres) / scale.relative_sigma;
  return error * error;
}

double medianSquaredError(double claimed) {
  std::vector<double> errors;
  for (unsigned seed = 1; seed <= 101; ++seed) {
    const Scene scene(seed);
    errors.push_back(squaredError(scaleFromDepth(scene.result, scene.known(claimed)).value()));
  }
  std::nth_element(errors.begin(), errors.begin() + 50, errors.end());
  return errors[50];
}

TEST(ScaleFromDepth, SigmaIsRightHoweverLargeTheClaimedOne) {
  // Median of chi^2 with one degree of freedom: 0.455; 101 medians scatter by 0.1.
  EXPECT_NEAR(medianSquaredError(kSigma), .455, .3);
  EXPECT_NEAR(medianSquaredError(10 * kSigma), .455, .3);
}

TEST(ScaleFromDepth, OutliersHardlyMoveIt) {
  Scene scene(7);
  for (std::size_t i = 0; i < scene.result.points.size(); i += 20) {  // 5 %
    const Eigen::Vector2f& pixel = scene.result.points[i].pixel;
    scene.at(static_cast<int>(pixel.x()), static_cast<int>(pixel.y())) = 50;
  }
  const auto scale = scaleFromDepth(scene.result, scene.known());
  ASSERT_TRUE(scale);
  EXPECT_LT(std::abs(std::log(scale->metres / kMetres)), .01);  // a fifth of one depth's noise more
}

TEST(ScaleFromDepth, DepthsThatContradictGiveNone) {
  Scene scene(7);
  for (float& depth : scene.depth) depth = depth > 0 ? 1 / depth : depth;
  EXPECT_FALSE(scaleFromDepth(scene.result, scene.known()));
}

TEST(ScaleFromDepth, FewDepthsGiveNone) {
  Scene scene(7);
  scene.result.points.resize(40);
  const std::vector<InitPoint> points = scene.result.points;
  EXPECT_TRUE(scaleFromDepth(scene.result, scene.known()));
  const float nothing[] = {0, -1, std::numeric_limits<float>::quiet_NaN()};
  for (std::size_t i = 0; i < 21; ++i) {
    const Eigen::Vector2f& pixel = points[i].pixel;
    scene.at(static_cast<int>(pixel.x()), static_cast<int>(pixel.y())) = nothing[i % 3];
  }
  EXPECT_FALSE(scaleFromDepth(scene.result, scene.known()));
}

TEST(ScaleFromDepth, RefusesWhatIsNoDepthOfTheReference) {
  const Scene scene(7);
  KnownDepth known = scene.known();
  known.relative_sigma = 0;
  EXPECT_THROW((void)scaleFromDepth(scene.result, known), std::invalid_argument);
  known = scene.known();
  known.depth = {scene.depth.data(), kWidth - 1, kHeight, kWidth * sizeof(float)};
  EXPECT_THROW((void)scaleFromDepth(scene.result, known), std::invalid_argument);
  known.depth = {};
  EXPECT_THROW((void)scaleFromDepth(scene.result, known), std::invalid_argument);
}

TEST(ScaleFromDistance, HasTheErrorsOfDistanceAndPose) {
  const Scene scene(7);
  const auto scale = scaleFromDistance(scene.result, {FrameId{1}, 1.25, .05});
  ASSERT_TRUE(scale);
  EXPECT_NEAR(scale->metres, kMetres, 1e-12);  // the camera moved by 0.5
  EXPECT_NEAR(scale->relative_sigma, std::hypot(.04, .02), 1e-12);
  EXPECT_FALSE(scaleFromDistance(scene.result, {FrameId{9}, 1.25, .05}));
  EXPECT_THROW((void)scaleFromDistance(scene.result, {FrameId{1}, 0, .05}), std::invalid_argument);
}

FramePtr frameKnowing(int id, const FramePriors& priors) {
  const std::vector<float> pixels(static_cast<std::size_t>(kWidth) * kHeight, 100);
  FrameInfo info{FrameId{id}, .1 * id};
  info.priors = std::make_shared<FramePriors>(priors);
  return Frame::create({pixels.data(), kWidth, kHeight}, info);
}

/// A start whose camera moves by .3 and then by .4 in another direction.
InitializationResult twoSteps(const FramePriors& first, const FramePriors& second) {
  InitializationResult result;
  result.frames.push_back({greyFrame(0), SE3(), {}, std::nullopt});
  const SE3 one(Eigen::Matrix3d::Identity(), Eigen::Vector3d(.3, 0, 0));
  const SE3 two(Eigen::Matrix3d::Identity(), Eigen::Vector3d(.3, 0, .4));
  result.frames.push_back({frameKnowing(1, first), one, {}, Matrix6d::Identity() * 1e-4});
  result.frames.push_back({frameKnowing(2, second), two, {}, Matrix6d::Identity() * 1e-4});
  return result;
}

FramePriors moved(int since, double metres, double sigma) {
  FramePriors priors;
  priors.distance = DistancePrior{FrameId{since}, metres, sigma};
  return priors;
}

TEST(ScaleFromDistances, WeighsThemAndHasTheErrorOfThePose) {
  const auto both = scaleFromDistances(twoSteps(moved(0, .75, .01), moved(1, 1, .01)));
  ASSERT_TRUE(both);
  EXPECT_NEAR(both->metres, kMetres, 1e-3) << "less the noise that they have in the mean";
  // .01 m on both: relative 0.01 / (2.5 * 0.5); the pose's: 0.01 / 0.5.
  EXPECT_NEAR(both->relative_sigma, std::hypot(.008, .02), 1e-5);
  const auto uneven = scaleFromDistances(twoSteps(moved(0, .75, .001), moved(1, 2, 10)));
  ASSERT_TRUE(uneven);
  EXPECT_NEAR(uneven->metres, kMetres, 2e-5);
  EXPECT_FALSE(scaleFromDistances(twoSteps({}, {})));
  EXPECT_FALSE(scaleFromDistances(twoSteps(moved(7, 1, .1), {})));  // since no frame of the start
  InitializationResult unsure = twoSteps(moved(0, .75, .01), {});
  unsure.frames.back().covariance.reset();
  EXPECT_FALSE(scaleFromDistances(unsure));
}

/// Mean of the unit over many starts of ten steps of .04, whose poses are off by `noise`.
double meanMetres(double noise, double sigma) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, 1);
  double sum = 0;
  constexpr int kStarts = 400;
  for (int i = 0; i < kStarts; ++i) {
    InitializationResult result;
    for (int k = 0; k <= 10; ++k) {
      const double along = k == 0 ? 0 : .04 * k + noise * normal(random);
      const FramePriors priors =
          k == 0 ? FramePriors() : moved(k - 1, kMetres * .04 + sigma * normal(random), sigma);
      result.frames.push_back({frameKnowing(k, priors),
                               SE3(Eigen::Matrix3d::Identity(), {along, 0, 0}),
                               {},
                               Matrix6d::Identity() * 1e-4});
    }
    sum += scaleFromDistances(result).value().metres;
  }
  return sum / kStarts;
}

TEST(ScaleFromDistances, NoiseOfNeitherSideBiasesIt) {
  // Measured 2.50 and 2.47. A regression on the poses' lengths has 2.16 and 2.49, one on the known
  // ones 2.50 and 2.70.
  EXPECT_NEAR(meanMetres(.012, .001), kMetres, .06);
  EXPECT_NEAR(meanMetres(.001, .03), kMetres, .06);
}

TEST(ScaleFromDistances, TakesTranslationsOfPosesUnlessTheImagesContradictThem) {
  Matrix6d covariance = Matrix6d::Identity() * 1e-12;  // of rotations: they move no translation
  covariance.topLeftCorner<3, 3>() = Eigen::Matrix3d::Identity() * 1e-4;
  FramePriors pose;
  pose.pose = poseSince(FrameId{0}, SE3(Eigen::Matrix3d::Identity(), {.75, 0, 0}), covariance);
  InitializationResult result = twoSteps(pose, {});
  const auto scale = scaleFromDistances(result);
  ASSERT_TRUE(scale);
  EXPECT_NEAR(scale->metres, kMetres, 2e-3) << "less the noise that it has in the mean";
  EXPECT_NEAR(scale->relative_sigma, std::hypot(.01 / .75, .02), 1e-5);
  result.report.pose_prior = false;
  EXPECT_FALSE(scaleFromDistances(result));
  FramePriors rotation;
  rotation.pose = rotationSince(FrameId{0}, Eigen::Matrix3d::Identity(), .01);
  EXPECT_FALSE(scaleFromDistances(twoSteps(rotation, {})));
}

TEST(ToMetres, ChangesPosesDepthsAndTheirCovariances) {
  Scene scene(7);
  const InitializationResult before = scene.result;
  toMetres({kMetres, .01, 0}, scene.result);
  const InitPoint& point = scene.result.points[3];
  EXPECT_NEAR(point.inverse_depth, before.points[3].inverse_depth / kMetres, 1e-6);
  EXPECT_NEAR(point.variance, before.points[3].variance / (kMetres * kMetres), 1e-9);
  EXPECT_NEAR(scene.result.frames[1].T_cam_ref->translation().norm(), 1.25, 1e-12);
  EXPECT_NEAR((*scene.result.frames[1].covariance)(0, 0), 1e-4 * kMetres * kMetres, 1e-12);
  EXPECT_THROW(toMetres({}, scene.result), std::invalid_argument);
  scene.result.metric = MetricScale{2, .01, 0};
  toMetres(*scene.result.metric, scene.result);
  EXPECT_NEAR(scene.result.frames[1].T_cam_ref->translation().norm(), 2.5, 1e-12);
  EXPECT_EQ(scene.result.metric->metres, 1);
}

TEST(ScaleFromDepth, RefusesAPriorWithoutASigmaForEveryPixel) {
  const Scene scene(1);
  DepthPrior prior{kWidth, kHeight, scene.depth, {}};
  EXPECT_THROW((void)scaleFromDepth(scene.result, prior), std::invalid_argument);
  prior.sigma.assign(scene.depth.size(), .02F);
  EXPECT_TRUE(scaleFromDepth(scene.result, prior));
}

TEST(ScaleFromDistances, NothingComesOfNoFrames) {
  EXPECT_FALSE(scaleFromDistances({}));
}

}  // namespace
}  // namespace dsorb
