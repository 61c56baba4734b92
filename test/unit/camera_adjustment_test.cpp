// SPDX-License-Identifier: BSD-3-Clause
// A camera, views and corners that fit exactly: the adjustment comes back to them from elsewhere.
#include "self_calibration/camera_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace dsorb::self_calibration {
namespace {

constexpr double kNoise = 0.2;  // [px]

LensVector truth() {
  return (LensVector() << std::log(500.0), 325, 236, -0.25, 0.06, -0.02, 0.02, 0, -0.05).finished();
}

Eigen::Vector2d seen(const LensVector& lens, const Eigen::Vector3d& p) {
  const Eigen::Vector2d ray = p.head<2>() / p.z();
  const double r2 = ray.squaredNorm();
  const Eigen::Vector2d focal(std::exp(lens[0]), std::exp(lens[0] + lens[kAspect]));
  return (1 + r2 * (lens[3] + r2 * (lens[4] + r2 * lens[5]))) * focal.cwiseProduct(ray) +
         lens.segment<2>(1);
}

/// A camera that turns and moves before a cloud of points; corners are not placed yet.
Scene sceneWithNoise(double noise) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto vector = [&](double scale) {
    const double x = normal(random), y = normal(random);
    return Eigen::Vector3d(scale * x, scale * y, scale * normal(random));
  };
  Scene scene;
  scene.lens = truth();
  for (int i = 0; i < 12; ++i) {
    Vector6d motion;
    motion << vector(0.4), vector(0.12);
    scene.views.push_back(SE3::exp(motion));
  }
  for (std::size_t corner = 0; corner < 200; ++corner) {
    const Eigen::Vector3d point =
        vector(1.0).cwiseProduct(Eigen::Vector3d(1.5, 1.1, 0.7)) + Eigen::Vector3d(0, 0, 4);
    scene.corners.emplace_back(0, 0, 0);
    for (std::size_t view = 0; view < scene.views.size(); ++view) {
      Sight sight{view, corner, seen(scene.lens, scene.views[view] * point)};
      sight.drift = 60 * vector(1.0).head<2>();
      sight.pixel += scene.lens[kReadout] * sight.drift + noise * vector(1.0).head<2>();
      scene.sights.push_back(sight);
    }
  }
  return scene;
}

LensPrior wide() {
  LensPrior prior;
  prior.mean << std::log(560.0), 319.5, 239.5, 0, 0, 0, 0, 0, 0;
  prior.sigma << 0.3, 13, 13, 0.3, 0.15, 0.05, 0.02, 0, 0.3;
  return prior;
}

TEST(CameraAdjustment, FindsLensAndReadoutFromAWrongGuess) {
  Scene scene = sceneWithNoise(0);
  scene.lens = wide().mean;
  placeCorners(scene);
  const std::size_t corners = scene.corners.size();
  EXPECT_GT(corners, 180U);
  adjust(wide(), 0.01, 60, scene);
  EXPECT_EQ(scene.corners.size(), corners);
  for (int i = 0; i < kLensDim; ++i) {
    EXPECT_NEAR(scene.lens[i], truth()[i], 2e-3 * std::max(1.0, std::abs(truth()[i]))) << i;
  }
}

/// A camera that drives straight on through a street, where a focal length hardly shows.
Scene street() {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Scene scene;
  scene.lens = truth();
  scene.lens[kRadial + 2] = 0;
  for (int i = 0; i < 30; ++i) {
    Vector6d motion;
    motion << 0, 0, -0.4 * i, 0.01 * std::sin(0.7 * i), 0.004 * i, 0;
    scene.views.push_back(SE3::exp(motion));
  }
  while (scene.corners.size() < 300) {
    const double side = uniform(random) > 0 ? 6 : -6;
    const double y = 3 * uniform(random), z = 26 + 22 * uniform(random);
    std::vector<Sight> sights;
    for (std::size_t view = 0; view < scene.views.size(); ++view) {
      const Eigen::Vector3d p = scene.views[view] * Eigen::Vector3d(side, y, z);
      if (p.z() < 1 || p.head<2>().norm() > 0.8 * p.z()) continue;
      const Eigen::Vector2d error(uniform(random), uniform(random));
      sights.push_back({view, scene.corners.size(), seen(scene.lens, p) + 0.1 * error});
    }
    if (sights.size() < 4) continue;
    scene.sights.insert(scene.sights.end(), sights.begin(), sights.end());
    scene.corners.emplace_back(0, 0, 0);
  }
  return scene;
}

TEST(CameraAdjustment, FollowsTheValleyOfACameraThatMovesStraightOn) {
  Scene scene = street();
  scene.lens = wide().mean;
  scene.lens[kLogFocal] = std::log(800.0);
  placeCorners(scene);
  LensPrior prior = wide();
  prior.sigma[kReadout] = prior.sigma[kRadial + 2] = 0;
  adjust(prior, 0.06, 30, scene);
  const double off = scene.lens[kLogFocal] - truth()[kLogFocal];
  const double sigma = lensSigmas(prior, 0.06, scene)[kLogFocal];
  EXPECT_LT(std::abs(off), 3 * sigma) << off << " +- " << sigma;
  EXPECT_LT(sigma, 0.02);  // .009
}

TEST(CameraAdjustment, SigmasAreThoseOfTheNoise) {
  Scene scene = sceneWithNoise(kNoise);
  scene.lens = wide().mean;
  placeCorners(scene);
  // The guess is far away: at this noise all corners are outliers there.
  for (const double noise : {10 * kNoise, kNoise, kNoise}) adjust(wide(), noise, 60, scene);
  const LensVector sigmas = lensSigmas(wide(), kNoise, scene);
  const LensVector of_all = (scene.lens - truth()).cwiseQuotient(sigmas);
  const Eigen::VectorXd off = of_all.head<kZoom>();  // all that is not held, but for the ratio
  EXPECT_LT(off.cwiseAbs().maxCoeff(), 3.5) << off.transpose();
  EXPECT_LT(std::abs(of_all[kAspect]), 3.5);
  EXPECT_GT(off.norm(), 0.3) << "not much surer than they are";
  EXPECT_LT(sigmas[kLogFocal], 0.01);
}

TEST(CameraAdjustment, WhatHasNoSigmaIsHeld) {
  Scene scene = sceneWithNoise(0);
  placeCorners(scene);
  LensPrior prior = wide();
  prior.sigma[kRadial] = prior.sigma[kReadout] = 0;
  scene.lens[kRadial] = -0.1;
  adjust(prior, kNoise, 10, scene);
  EXPECT_EQ(scene.lens[kRadial], -0.1);
  EXPECT_EQ(scene.lens[kReadout], truth()[kReadout]);
  EXPECT_EQ(lensSigmas(prior, kNoise, scene)[kRadial], 0);
}

TEST(CameraAdjustment, AFocalLengthThatChangesIsToldFromOneThatStays) {
  for (const double zoom : {1.0, 1.05}) {
    SCOPED_TRACE(zoom);
    Scene scene = sceneWithNoise(kNoise);
    const Eigen::Vector2d center = truth().segment<2>(kCenter);
    for (Sight& sight : scene.sights) {
      const double scale = std::pow(zoom, static_cast<double>(sight.view) / 11);
      sight.pixel = center + scale * (sight.pixel - center);
    }
    placeCorners(scene);
    adjust(wide(), kNoise, 60, scene);
    const FocalChange change = focalChange(wide(), kNoise, 60, scene);
    EXPECT_NEAR(change.relative, std::log(zoom), 4 * change.sigma);
    EXPECT_LT(change.sigma, 0.01);
    EXPECT_EQ(scene.lens[kZoom], 0) << "held otherwise";
  }
}

TEST(CameraAdjustment, ImagesThatMoveInTheirFrameAreToldFromThoseThatDoNot) {
  for (const double crop : {0.0, 10.0}) {
    SCOPED_TRACE(crop);
    Scene scene = sceneWithNoise(kNoise);
    for (Sight& sight : scene.sights) {
      const auto view = static_cast<double>(sight.view);
      sight.pixel += crop * Eigen::Vector2d(std::sin(view), std::cos(1.7 * view));
    }
    placeCorners(scene);
    adjust(wide(), kNoise, 60, scene);
    const ViewShifts shifts = viewShifts(wide(), kNoise, 13, 60, scene);
    EXPECT_NEAR(shifts.rms, crop, 3);
    EXPECT_EQ(shifts.gain > 64, crop > 0) << shifts.gain;
    EXPECT_TRUE(scene.shifts.front().isZero(0)) << "held otherwise";
  }
}

TEST(CameraAdjustment, CornersWithALargeErrorGoWithTheirSights) {
  Scene scene = sceneWithNoise(0);
  placeCorners(scene);
  leaveOutAbove(5, scene);  // those that the lens to begin with is too wrong for
  const std::size_t corners = scene.corners.size();
  const std::size_t sights = scene.sights.size();
  scene.sights[5].pixel.x() += 20;
  leaveOutAbove(5, scene);
  EXPECT_EQ(scene.corners.size(), corners - 1);
  EXPECT_EQ(scene.sights.size(), sights - 12);
}

}  // namespace
}  // namespace dsorb::self_calibration
