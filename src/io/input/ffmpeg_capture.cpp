// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/codecs.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libswscale/swscale.h>
}

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kUsualRate = 30;
constexpr double kMaxRate = 1e4;
constexpr double kMaxImages = 1e9;
constexpr int kWrittenAtOnce = 64;       // pixels that FFmpeg may write past the end of a row
constexpr double kRightAngle = 90;       // [degrees]
constexpr double kAngleTolerance = 0.5;  // [degrees]
// For the opening of an address; FFmpeg looks for up to 5 s at what a stream holds.
constexpr std::chrono::milliseconds kAddressPatience(10000);
constexpr std::chrono::milliseconds kReadingPatience(5000);  // for an image

/// What FFmpeg would show of texts, single images and lists of other files is no video of ours.
constexpr std::string_view kNoVideos =
    " tty concat hls dash image2 image2pipe webm_dash_manifest sdp imf ffmetadata lavfi ";

bool isNoVideo(const std::string& demuxer) {
  constexpr std::string_view kPipe = "_pipe";  // of single images
  const bool image = demuxer.size() > kPipe.size() &&
                     demuxer.compare(demuxer.size() - kPipe.size(), kPipe.size(), kPipe) == 0;
  return image || kNoVideos.find(" " + demuxer + " ") != std::string_view::npos;
}

struct Free {
  void operator()(AVFormatContext* format) const { avformat_close_input(&format); }
  void operator()(AVIOContext* file) const { avio_closep(&file); }
  void operator()(AVCodecContext* decoder) const { avcodec_free_context(&decoder); }
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
  void operator()(SwsContext* converter) const { sws_freeContext(converter); }
};
template <typename T>
using Owned = std::unique_ptr<T, Free>;

#if LIBAVUTIL_VERSION_MAJOR >= 59
bool isInterlaced(const AVFrame& frame) {
  return (frame.flags & AV_FRAME_FLAG_INTERLACED) != 0;
}
bool topFieldFirst(const AVFrame& frame) {
  return (frame.flags & AV_FRAME_FLAG_TOP_FIELD_FIRST) != 0;
}
#else
bool isInterlaced(const AVFrame& frame) {
  return frame.interlaced_frame != 0;
}
bool topFieldFirst(const AVFrame& frame) {
  return frame.top_field_first != 0;
}
#endif

const void* sideData(const AVStream& stream, AVPacketSideDataType type) {
#if LIBAVCODEC_VERSION_MAJOR >= 61
  const AVCodecParameters& codec = *stream.codecpar;
  const AVPacketSideData* data =
      av_packet_side_data_get(codec.coded_side_data, codec.nb_coded_side_data, type);
  return data == nullptr ? nullptr : data->data;
#else
  return av_stream_get_side_data(&stream, type, nullptr);
#endif
}

/// The rows between those of one field, as the mean of their neighbours.
/// @param first whether the field has the first row of the image
cv::Mat interpolateRows(const cv::Mat& field, bool first) {
  cv::Mat image(2 * field.rows, field.cols, field.type());
  for (int row = 0; row < image.rows; ++row) {
    const int twice = row - (first ? 0 : 1);  // twice the row of the field
    const int low = std::max(twice, 0) / 2;
    const int high = std::min((std::max(twice, 0) + (twice >= 0 ? 1 : 0)) / 2, field.rows - 1);
    if (low == high) {
      field.row(low).copyTo(image.row(row));
    } else {
      cv::Mat mean = image.row(row);
      cv::addWeighted(field.row(low), 0.5, field.row(high), 0.5, 0, mean);
    }
  }
  return image;
}

/// Members end in the reverse order: the decoder before the container, that before its file.
class FfmpegCapture final : public Capture {
 public:
  /// @return what is wrong; empty: nothing
  std::string open(const std::string& address) {
    is_file_ = address.find("://") == std::string::npos;
    patience(kAddressPatience);
    std::string why = is_file_ ? openFile(address) : std::string();
    if (why.empty() && !openContainer(address)) why = closedReason();
    if (why.empty()) why = openDecoder();
    if (why.empty()) describe();
    return why;
  }

  bool grab() override {
    patience(kReadingPatience);
    while (true) {
      const int code = avcodec_receive_frame(decoder_.get(), frame_.get());
      if (code == 0) return settle();
      if (code == AVERROR_EOF || (code != AVERROR(EAGAIN) && drained_)) return false;
      if (code != AVERROR(EAGAIN)) damaged_ = true;
      feed();
    }
  }

  bool retrieve(SourceImage& image) override {
    const AVFrame& frame = *frame_;
    std::array<const std::uint8_t*, 4> data{};
    std::array<int, 4> strides{};
    const bool interlaced = isInterlaced(frame) && frame.height % 2 == 0;
    const bool first = topFieldFirst(frame) || frame.height % 4 != 0;  // chroma has half the rows
    for (std::size_t i = 0; i < data.size(); ++i) {
      const bool second_row = interlaced && !first && frame.data[i] != nullptr;
      data[i] = frame.data[i] + (second_row ? frame.linesize[i] : 0);
      strides[i] = frame.linesize[i] * (interlaced ? 2 : 1);
    }
    const int height = frame.height / (interlaced ? 2 : 1);
    const auto format = static_cast<AVPixelFormat>(frame.format);
    converter_.reset(sws_getCachedContext(converter_.release(),
                                          frame.width,
                                          height,
                                          format,
                                          frame.width,
                                          height,
                                          AV_PIX_FMT_BGR24,
                                          SWS_BICUBIC,
                                          nullptr,
                                          nullptr,
                                          nullptr));
    if (!converter_) return false;
    cv::Mat padded(height, (frame.width / kWrittenAtOnce + 1) * kWrittenAtOnce, CV_8UC3);
    cv::Mat bgr = padded.colRange(0, frame.width);
    std::array<std::uint8_t*, 4> rows{bgr.data};
    const std::array<int, 4> step{static_cast<int>(bgr.step)};
    const int done = sws_scale(
        converter_.get(), data.data(), strides.data(), 0, height, rows.data(), step.data());
    if (done != height) return false;
    image.pixels = turned(interlaced ? interpolateRows(bgr, first) : bgr.clone(), turn_);
    image.turn = turn_;
    image.pixel_aspect = pixel_aspect_;
    return true;
  }

  [[nodiscard]] double time() const override { return time_; }
  [[nodiscard]] double rate() const override { return rate_; }
  [[nodiscard]] int announced() const override { return announced_; }

  /// Times count from 0 in some containers and from their first image in others: the end that is
  /// nearer counts. FFmpeg mends the length of an AVI that is cut off, but not its number of
  /// images; an edit list of MP4 hides some of its number.
  [[nodiscard]] double missingShare() const override {
    if (format_->duration_estimation_method == AVFMT_DURATION_FROM_BITRATE) return 0;
    const bool hides =
        std::string_view(format_->iformat->name).find("mov") != std::string_view::npos;
    const double counted = hides ? 0 : static_cast<double>(stream_->nb_frames) / rate_;
    const double announced = std::max(seconds(format_->duration), counted);
    const double begin = seconds(format_->start_time);
    return announced > 0 ? std::max(0.0, 1 - std::max(end_, end_ - begin) / announced) : 0;
  }

  [[nodiscard]] std::string takeDoubts() override {
    if (std::exchange(damaged_, false) && !std::exchange(damage_told_, true)) {
      doubts_.emplace_back(
          "damaged, as later ones may be: the decoder fills in what it cannot read");
    }
    std::string all;
    for (const std::string& doubt : doubts_) all += (all.empty() ? "" : "; ") + doubt;
    doubts_.clear();
    return all;
  }

 private:
  static double seconds(std::int64_t time) {
    return time == AV_NOPTS_VALUE ? 0 : static_cast<double>(time) / AV_TIME_BASE;
  }
  void patience(std::chrono::milliseconds time) { deadline_ = Clock::now() + time; }
  static int isLate(void* capture) {
    return Clock::now() > static_cast<FfmpegCapture*>(capture)->deadline_ ? 1 : 0;
  }

  /// The demuxer is chosen before it may follow what the file names.
  std::string openFile(const std::string& path) {
    AVIOContext* file = nullptr;
    const std::string url = "file:" + path;
    if (avio_open2(&file, url.c_str(), AVIO_FLAG_READ, nullptr, nullptr) < 0) {
      return "cannot be opened";
    }
    file_.reset(file);
    score_ = av_probe_input_buffer2(file, &demuxer_, path.c_str(), nullptr, 0, 0);
    if (score_ < 0 || demuxer_ == nullptr || isNoVideo(demuxer_->name)) {
      return "no video that can be decoded";
    }
    return {};
  }

  bool openContainer(const std::string& address) {
    AVFormatContext* format = avformat_alloc_context();
    if (format == nullptr) return false;
    AVDictionary* options = nullptr;
    if (is_file_) {
      format->pb = file_.get();
    } else {
      format->interrupt_callback = {&FfmpegCapture::isLate, this};
      av_dict_set(&options, "rtsp_flags", "prefer_tcp", 0);
    }
    const int code = avformat_open_input(&format, address.c_str(), demuxer_, &options);
    av_dict_free(&options);
    if (code < 0) return false;
    format_.reset(format);
    return avformat_find_stream_info(format, nullptr) >= 0;
  }

  /// Why the container did not open. Recorders write the index of MP4's family at the end.
  [[nodiscard]] std::string closedReason() const {
    const bool mp4 =
        score_ > AVPROBE_SCORE_EXTENSION && std::string_view(demuxer_->name).substr(0, 3) == "mov";
    return mp4 ? "its index (moov) is missing or damaged: the recording was not finished or the "
                 "file is cut off; a tool like untrunc makes a new one by another recording of "
                 "the camera"
               : "no video that can be decoded";
  }

  std::string openDecoder() {
    const AVCodec* codec = nullptr;
    const int best = av_find_best_stream(format_.get(), AVMEDIA_TYPE_VIDEO, -1, -1, &codec, 0);
    stream_ = best >= 0 ? format_->streams[best] : nullptr;
    if (stream_ == nullptr || (stream_->disposition & AV_DISPOSITION_ATTACHED_PIC) != 0) {
      const bool sound =
          av_find_best_stream(format_.get(), AVMEDIA_TYPE_AUDIO, -1, -1, nullptr, 0) >= 0;
      return sound ? "sound only: it has no pictures" : "holds no image that can be decoded";
    }
    if (codec == nullptr) {
      return std::string("its pictures are ") + avcodec_get_name(stream_->codecpar->codec_id) +
             ", which this FFmpeg cannot decode";
    }
    decoder_.reset(avcodec_alloc_context3(codec));
    avcodec_parameters_to_context(decoder_.get(), stream_->codecpar);
    decoder_->pkt_timebase = stream_->time_base;
    decoder_->thread_count = 0;  // as many as there are processors
    if (avcodec_open2(decoder_.get(), codec, nullptr) < 0) return "no video that can be decoded";
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    return {};
  }

  /// What the container says of all images.
  void describe() {
    const double rate = av_q2d(av_guess_frame_rate(format_.get(), stream_, nullptr));
    rate_ = rate > 0 && rate < kMaxRate ? rate : kUsualRate;
    const double length = stream_->duration != AV_NOPTS_VALUE
                              ? static_cast<double>(stream_->duration) * av_q2d(stream_->time_base)
                              : std::max(seconds(format_->duration), 0.0);
    const double count = stream_->nb_frames > 0 ? static_cast<double>(stream_->nb_frames)
                                                : std::floor(length * rate_ + 0.5);
    announced_ = count > 0 && count < kMaxImages ? static_cast<int>(count) : 0;
    describeDisplay();
    const AVRational aspect = av_guess_sample_aspect_ratio(format_.get(), stream_, nullptr);
    if (aspect.num > 0 && aspect.den > 0) {
      pixel_aspect_ = turn_ % 180 == 0 ? av_q2d(aspect) : 1 / av_q2d(aspect);
    }
    for (const auto& [type, what] :
         {std::pair(AV_PKT_DATA_SPHERICAL, "spherical (360 degrees); a camera with a lens is"),
          std::pair(AV_PKT_DATA_STEREO3D, "stereo pairs; those of one camera are")}) {
      if (sideData(*stream_, type) == nullptr) continue;
      doubts_.push_back(std::string("the container calls the images ") + what + " expected");
    }
    const auto videos =
        std::count_if(format_->streams, format_->streams + format_->nb_streams, [](auto* stream) {
          return stream->codecpar->codec_type == AVMEDIA_TYPE_VIDEO &&
                 (stream->disposition & AV_DISPOSITION_ATTACHED_PIC) == 0;
        });
    if (videos > 1) {
      doubts_.push_back("the file has " + std::to_string(videos) + " videos; number " +
                        std::to_string(stream_->index) + " of its streams is used");
    }
  }

  /// FFmpeg's angle is counter-clockwise.
  void describeDisplay() {
    const auto* matrix =
        static_cast<const std::int32_t*>(sideData(*stream_, AV_PKT_DATA_DISPLAYMATRIX));
    if (matrix == nullptr) return;
    const double mirror =
        static_cast<double>(matrix[0]) * matrix[4] - static_cast<double>(matrix[1]) * matrix[3];
    const double angle = -av_display_rotation_get(matrix);
    const double quarters = std::round(angle / kRightAngle);
    if (mirror < 0 || !(std::abs(angle - kRightAngle * quarters) <= kAngleTolerance)) {
      doubts_.emplace_back(
          "the container asks to show the images mirrored or turned by no right "
          "angle; they are taken as they are stored");
      return;
    }
    turn_ = ((static_cast<int>(quarters) % 4 + 4) % 4) * 90;
  }

  /// Hands the next packet to the decoder, or tells it that there are no more.
  void feed() {
    while (!drained_) {
      const int code = av_read_frame(format_.get(), packet_.get());
      if (code == AVERROR(EAGAIN)) continue;
      if (code < 0) {
        drained_ = true;
        avcodec_send_packet(decoder_.get(), nullptr);
        return;
      }
      const AVStream& stream = *format_->streams[packet_->stream_index];
      const std::int64_t time = packet_->pts != AV_NOPTS_VALUE ? packet_->pts : packet_->dts;
      if (time != AV_NOPTS_VALUE) {
        end_ = std::max(end_,
                        static_cast<double>(time + packet_->duration) * av_q2d(stream.time_base));
      }
      const bool ours = packet_->stream_index == stream_->index;
      const int sent = ours ? avcodec_send_packet(decoder_.get(), packet_.get()) : 0;
      av_packet_unref(packet_.get());
      if (sent < 0) damaged_ = true;
      if (ours) return;
    }
  }

  /// Takes what is to be known of the frame that was decoded. The last ones of a stream that is
  /// reordered come without a time, and some containers have none.
  bool settle() {
    const std::int64_t stamp = frame_->best_effort_timestamp;
    const std::int64_t first = stream_->start_time != AV_NOPTS_VALUE ? stream_->start_time : 0;
    const double time = stamp != AV_NOPTS_VALUE
                            ? static_cast<double>(stamp - first) * av_q2d(stream_->time_base)
                            : 0;
    if (!begun_ && stamp == AV_NOPTS_VALUE) {
      doubts_.push_back("the file has no times: images are taken to be " +
                        std::to_string(1 / rate_) + " s apart");
    }
    time_ = !begun_ || time > time_ ? time : time_ + 1 / rate_;
    begun_ = true;
    damaged_ =
        damaged_ || frame_->decode_error_flags != 0 || (frame_->flags & AV_FRAME_FLAG_CORRUPT) != 0;
    if (isInterlaced(*frame_) && !std::exchange(interlaced_told_, true)) {
      doubts_.emplace_back(
          "interlaced: every second row is of another moment; those rows are interpolated from the "
          "others");
    }
    return true;
  }

  bool is_file_ = true;
  Clock::time_point deadline_;
  const AVInputFormat* demuxer_ = nullptr;
  int score_ = 0;  // how sure the demuxer is, by the file's name alone AVPROBE_SCORE_EXTENSION
  Owned<AVIOContext> file_;
  Owned<AVFormatContext> format_;
  AVStream* stream_ = nullptr;
  Owned<AVCodecContext> decoder_;
  Owned<AVFrame> frame_;
  Owned<AVPacket> packet_;
  Owned<SwsContext> converter_;
  double rate_ = kUsualRate;
  double pixel_aspect_ = 1;
  int announced_ = 0;
  int turn_ = 0;     // clockwise [degrees]
  double time_ = 0;  // [s]
  double end_ = 0;   // of what was read, of any stream [s]
  bool begun_ = false;
  bool drained_ = false;
  bool damaged_ = false;  // since it was told
  bool damage_told_ = false;
  bool interlaced_told_ = false;
  std::vector<std::string> doubts_;
};

}  // namespace

std::unique_ptr<Capture> openFfmpegCapture(const std::string& address, std::string& why) {
  av_log_set_level(AV_LOG_FATAL);  // what it says is said by us
  auto capture = std::make_unique<FfmpegCapture>();
  why = capture->open(address);
  if (!why.empty()) return nullptr;
  return capture;
}

}  // namespace dsorb
