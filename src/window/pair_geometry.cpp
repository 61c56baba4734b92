// SPDX-License-Identifier: BSD-3-Clause
#include "window/pair_geometry.h"

#include <optional>

namespace dsorb::window {
namespace {

void setFirst(const PinholeCamera& camera,
              const Keyframe& host,
              const Keyframe& target,
              PairGeometry& pair) {
  const SE3 T_target_host = target.T_cam_world_first * host.T_cam_world_first.inverse();
  const BrightnessTransfer transfer = brightnessTransfer(
      host.firstAffine(), host.frame->exposure(), target.firstAffine(), target.frame->exposure());
  pair.first = makeWarp<float>(camera, T_target_host);
  pair.host_offset_first = static_cast<float>(host.firstAffine().b);
  // Left increments: xi_relative = xi_target - Ad(T_target_host) xi_host; r falls with the gain.
  pair.to_host.setZero();
  pair.to_host.topLeftCorner<6, 6>() = -T_target_host.adjoint().transpose();
  pair.to_host(6, 6) = transfer.gain;
  pair.to_host(7, 7) = transfer.gain;
  pair.to_host = frameScale().asDiagonal() * pair.to_host;
  pair.to_target << 1, 1, 1, 1, 1, 1, -transfer.gain, -1;
  pair.to_target = frameScale().cwiseProduct(pair.to_target);
  pair.to_host_single = pair.to_host.cast<float>();
  pair.to_target_single = pair.to_target.cast<float>();
}

}  // namespace

PairTable::PairTable(const Window& window)
    : size_(window.keyframes.size()), rays_(window.camera()), pairs_(size_ * size_) {
  for (std::size_t host = 0; host < size_; ++host) {
    for (std::size_t target = 0; target < size_; ++target) {
      if (host == target) continue;
      setFirst(window.camera(),
               window.keyframes[host],
               window.keyframes[target],
               pairs_[host * size_ + target]);
    }
  }
  refreshCurrent(window);
}

void PairTable::refreshCurrent(const Window& window) {
  const PinholeCamera camera = window.camera();
  rays_ = HostRays(camera);
  std::vector<SE3> poses;
  std::vector<std::optional<RollingShutter>> shutters;
  for (const Keyframe& keyframe : window.keyframes) {
    poses.push_back(keyframe.T_cam_world());
    shutters.push_back(window.shutter(keyframe));
  }
  for (std::size_t host = 0; host < size_; ++host) {
    const Keyframe& from = window.keyframes[host];
    const SE3 T_world_host = poses[host].inverse();
    for (std::size_t target = 0; target < size_; ++target) {
      if (host == target) continue;
      const Keyframe& to = window.keyframes[target];
      const BrightnessTransfer transfer = brightnessTransfer(
          from.affine(), from.frame->exposure(), to.affine(), to.frame->exposure());
      PairGeometry& pair = pairs_[host * size_ + target];
      pair.current =
          makeTargetImage(camera, poses[target] * T_world_host, transfer, to.frame->level(0));
      if (shutters[host] && shutters[target]) {
        pair.current.setShutter(*shutters[target]);
        pair.host_shutter = *shutters[host];
      }
      pair.first.setCamera(camera);
    }
  }
}

}  // namespace dsorb::window
